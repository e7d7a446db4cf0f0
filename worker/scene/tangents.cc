#include "worker/scene/tangents.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <tuple>
#include <utility>
#include <vector>

#include "filter/image/portable_math.h"
#include "worker/scene/directions.h"

namespace lumifold::scene {
namespace {

// Corner numbers count through the whole mesh: corner c belongs to triangle c / 3.
using Corner = uint32_t;

constexpr uint32_t kNone32 = 0xffffffffu;

Corner NextCorner(Corner c) { return c % 3 == 2 ? c - 2 : c + 1; }
Corner PreviousCorner(Corner c) { return c % 3 == 0 ? c + 2 : c - 1; }

Vec3 OnPlane(Vec3 v, Vec3 normal) { return v - normal * Dot(v, normal); }

/// Orientation of the texture on one triangle.
struct FaceFrame {
  Vec3 tangent;                   // unit; direction in which texture coordinate u grows
  bool keeps_orientation = true;  // the texture is not mirrored
  bool is_flat = false;           // texture coordinates degenerate to a line or a point: no tangent
};

FaceFrame FrameOf(const std::array<Vec3, 3>& p, const std::array<Vec2, 3>& uv) {
  // In double, where products of floats stay within range.
  const double u1 = double{uv[1].x} - double{uv[0].x}, v1 = double{uv[1].y} - double{uv[0].y};
  const double u2 = double{uv[2].x} - double{uv[0].x}, v2 = double{uv[2].y} - double{uv[0].y};
  const double area = u1 * v2 - u2 * v1;
  FaceFrame frame;
  frame.keeps_orientation = area > 0;
  const double side = area > 0 ? 1 : -1;
  std::array<double, 3> t = {};
  double square = 0;
  for (int i = 0; i < 3; ++i) {
    const double e1 = double{p[1][i]} - double{p[0][i]}, e2 = double{p[2][i]} - double{p[0][i]};
    t[static_cast<size_t>(i)] = side * (e1 * v2 - e2 * v1);
    square += t[static_cast<size_t>(i)] * t[static_cast<size_t>(i)];
  }
  frame.is_flat = area == 0 || !(square > 0) || !std::isfinite(square);
  if (frame.is_flat) return frame;
  const double scale = 1 / std::sqrt(square);
  frame.tangent = {static_cast<float>(t[0] * scale), static_cast<float>(t[1] * scale),
                   static_cast<float>(t[2] * scale)};
  return frame;
}

/// A set of corners around one vertex that share a tangent.
struct Group {
  bool keeps_orientation = true;
  Vec3 normal;
  Vec3 sum = {0, 0, 0};  // of the triangles' tangents times angles
};

/// One side of an edge, between welded vertices.
struct Edge {
  uint32_t low = 0;
  uint32_t high = 0;
  bool is_backward = false;  // from high to low
  Corner corner = 0;         // where it starts
  auto Key() const { return std::make_tuple(low, high, is_backward, corner); }
  bool SameEnds(const Edge& other) const { return low == other.low && high == other.high; }
};

/// Computes the tangent of each corner of a mesh.
class TangentBuilder {
 public:
  /// `normals`: one for each vertex; `uvs`: with v pointing up.
  TangentBuilder(const Mesh& mesh, const std::vector<Vec3>& normals, const std::vector<Vec2>& uvs)
      : mesh_(mesh), normals_(normals), uvs_(uvs) {}

  void Run() {
    Weld();
    FindFrames();
    FindNeighbours();
    group_of_.assign(mesh_.triangles.size(), kNone32);
    for (Corner c = 0; c < group_of_.size(); ++c) {
      if (group_of_[c] == kNone32 && !frames_[c / 3].is_flat) Flood(c);
    }
  }

  /// The group of a corner. A triangle without a tangent whose neighbours have none either belongs to no
  /// group.
  Vec4 Tangent(Corner c) const {
    const Vec3 normal = normals_[mesh_.triangles[c]];
    if (group_of_[c] == kNone32) return WithHandedness(Perpendicular(normal), true);
    const Group& group = groups_[group_of_[c]];
    const Vec3 tangent = UnitVector(group.sum).value_or(Perpendicular(group.normal));
    return WithHandedness(tangent, group.keeps_orientation);
  }

 private:
  static Vec4 WithHandedness(Vec3 t, bool keeps_orientation) {
    return {t.x, t.y, t.z, keeps_orientation ? 1.0f : -1.0f};
  }

  auto Key(uint32_t vertex) const {
    const Vec3 p = mesh_.positions[vertex], n = normals_[vertex];
    const Vec2 uv = uvs_[vertex];
    return std::make_tuple(p.x, p.y, p.z, n.x, n.y, n.z, uv.x, uv.y);
  }

  /// Welds vertices: equal vertices get one number.
  void Weld() {
    std::vector<uint32_t> order(mesh_.positions.size());
    std::iota(order.begin(), order.end(), 0u);
    std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) { return Key(a) < Key(b); });
    welded_.resize(order.size());
    for (size_t i = 0; i < order.size(); ++i) {
      const bool same = i > 0 && Key(order[i - 1]) == Key(order[i]);
      welded_[order[i]] = same ? welded_[order[i - 1]] : order[i];
    }
  }

  uint32_t Welded(Corner c) const { return welded_[mesh_.triangles[c]]; }

  void FindFrames() {
    frames_.resize(mesh_.triangles.size() / 3);
    for (size_t t = 0; t < frames_.size(); ++t) {
      const uint32_t* v = &mesh_.triangles[3 * t];
      frames_[t] = FrameOf({mesh_.positions[v[0]], mesh_.positions[v[1]], mesh_.positions[v[2]]},
                           {uvs_[v[0]], uvs_[v[1]], uvs_[v[2]]});
    }
  }

  /// Pairs the two sides of each edge; edge c goes from corner c to the next.
  void FindNeighbours() {
    std::vector<Edge> edges;
    edges.reserve(mesh_.triangles.size());
    for (Corner c = 0; c < mesh_.triangles.size(); ++c) {
      const uint32_t a = Welded(c), b = Welded(NextCorner(c));
      edges.push_back({std::min(a, b), std::max(a, b), a > b, c});
    }
    std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) { return a.Key() < b.Key(); });
    across_.assign(edges.size(), kNone32);
    for (size_t first = 0, end = 0; first < edges.size(); first = end) {
      size_t middle = first;
      for (end = first; end < edges.size() && edges[end].SameEnds(edges[first]); ++end) {
        middle += edges[end].is_backward ? 0 : 1;
      }
      // Neighbours traverse their edge in opposite directions; if more than two meet, they are paired in
      // order.
      for (size_t i = 0; first + i < middle && middle + i < end; ++i) {
        const Corner a = edges[first + i].corner, b = edges[middle + i].corner;
        across_[a] = b;
        across_[b] = a;
      }
    }
  }

  /// Collects the corners connected with `seed` around its vertex in a new group.
  void Flood(Corner seed) {
    const auto index = static_cast<uint32_t>(groups_.size());
    groups_.push_back({frames_[seed / 3].keeps_orientation, normals_[mesh_.triangles[seed]], {0, 0, 0}});
    std::vector<Corner> waiting = {seed};
    while (!waiting.empty()) {
      const Corner c = waiting.back();
      waiting.pop_back();
      if (!Join(c, index)) continue;
      // Both edges that meet at this corner; across the edge that starts here, the vertex is the far end.
      const Corner leaving = across_[c], arriving = across_[PreviousCorner(c)];
      if (leaving != kNone32) waiting.push_back(NextCorner(leaving));
      if (arriving != kNone32) waiting.push_back(arriving);
    }
  }

  /// Adds corner `c` to the group unless it has a group or its triangle has the other orientation.
  bool Join(Corner c, uint32_t index) {
    if (group_of_[c] != kNone32) return false;
    Group& group = groups_[index];
    FaceFrame& frame = frames_[c / 3];
    const Corner first = c - c % 3;
    const bool is_free = frame.is_flat && group_of_[first] == kNone32 && group_of_[first + 1] == kNone32 &&
                         group_of_[first + 2] == kNone32;
    // A triangle without a tangent joins the first group that reaches it.
    if (is_free) frame.keeps_orientation = group.keeps_orientation;
    if (frame.keeps_orientation != group.keeps_orientation) return false;
    group_of_[c] = index;
    if (!frame.is_flat) AddTangent(c, frame.tangent, &group);
    return true;
  }

  void AddTangent(Corner c, Vec3 tangent, Group* group) const {
    const auto flattened = [&](Vec3 v) {
      return UnitVector(OnPlane(v, group->normal)).value_or(Vec3{0, 0, 0});
    };
    const auto position = [&](Corner corner) { return mesh_.positions[mesh_.triangles[corner]]; };
    // Edges are scaled to unit length first, so that the projection does not suffer from cancellation.
    const auto edge = [&](Corner to) {
      return flattened(UnitVector(position(to) - position(c)).value_or(Vec3{0, 0, 0}));
    };
    const float angle = Acos(Dot(edge(NextCorner(c)), edge(PreviousCorner(c))));
    group->sum += flattened(tangent) * angle;
  }

  const Mesh& mesh_;
  const std::vector<Vec3>& normals_;
  const std::vector<Vec2>& uvs_;
  std::vector<uint32_t> welded_;    // of each vertex: the first one equal to it
  std::vector<FaceFrame> frames_;   // of each triangle
  std::vector<Corner> across_;      // of each edge: the same one in the neighbouring triangle
  std::vector<uint32_t> group_of_;  // of each corner
  std::vector<Group> groups_;
};

template <typename T>
void TakeEach(const std::vector<uint32_t>& from, std::vector<T>* values) {
  if (values->empty()) return;
  std::vector<T> taken;
  taken.reserve(from.size());
  for (const uint32_t index : from) taken.push_back((*values)[index]);
  *values = std::move(taken);
}

/// Replaces vertex i by a copy of the old vertex from[i].
void TakeVertices(const std::vector<uint32_t>& from, Mesh* mesh) {
  TakeEach(from, &mesh->positions);
  TakeEach(from, &mesh->normals);
  TakeEach(from, &mesh->uvs[0]);
  TakeEach(from, &mesh->uvs[1]);
  TakeEach(from, &mesh->colors);
}

/// Gives each triangle its own vertices and returns a normal for each vertex.
std::vector<Vec3> SplitFaces(Mesh* mesh) {
  TakeVertices(mesh->triangles, mesh);
  std::iota(mesh->triangles.begin(), mesh->triangles.end(), 0u);
  std::vector<Vec3> normals(mesh->positions.size());
  for (size_t i = 0; i < normals.size(); i += 3) {
    const Vec3 origin = mesh->positions[i];
    const Vec3 face = Cross(mesh->positions[i + 1] - origin, mesh->positions[i + 2] - origin);
    const Vec3 normal = UnitVector(face).value_or(Vec3{0, 0, 1});
    for (size_t c = 0; c < 3; ++c) normals[i + c] = normal;
  }
  return normals;
}

/// The normal texture's transformed coordinates, with v pointing up as in MikkTSpace.
std::vector<Vec2> UpwardUvs(const TextureRef& ref, const std::vector<Vec2>& uvs) {
  std::vector<Vec2> upward;
  upward.reserve(uvs.size());
  for (const Vec2 uv : uvs) {
    const Vec2 up = {ref.row_u.x * uv.x + ref.row_u.y * uv.y, -(ref.row_v.x * uv.x + ref.row_v.y * uv.y)};
    // A transform may overflow to infinity or NaN; NaN cannot be sorted.
    upward.push_back(std::isfinite(up.x) && std::isfinite(up.y) ? up : Vec2{0, 0});
  }
  return upward;
}

/// The tangent that a corner needs at its vertex.
struct CornerTangent {
  uint32_t vertex = 0;
  Vec4 tangent;
  Corner corner = 0;
  auto Key() const { return std::make_tuple(vertex, tangent.x, tangent.y, tangent.z, tangent.w); }
};

/// Writes the corners' tangents to their vertices and splits vertices that get several.
void AssignTangents(const TangentBuilder& builder, Mesh* mesh) {
  std::vector<CornerTangent> wanted;
  wanted.reserve(mesh->triangles.size());
  for (Corner c = 0; c < mesh->triangles.size(); ++c) {
    wanted.push_back({mesh->triangles[c], builder.Tangent(c), c});
  }
  std::sort(wanted.begin(), wanted.end(), [](const CornerTangent& a, const CornerTangent& b) {
    return std::make_tuple(a.Key(), a.corner) < std::make_tuple(b.Key(), b.corner);
  });
  std::vector<uint32_t> from(mesh->positions.size());
  std::iota(from.begin(), from.end(), 0u);
  mesh->tangents.resize(from.size());
  uint32_t vertex = 0;
  for (size_t i = 0; i < wanted.size(); ++i) {
    const CornerTangent& w = wanted[i];
    if (i == 0 || wanted[i - 1].vertex != w.vertex) {
      vertex = w.vertex;
    } else if (wanted[i - 1].Key() != w.Key()) {
      vertex = static_cast<uint32_t>(from.size());
      from.push_back(w.vertex);
      mesh->tangents.emplace_back();
    }
    mesh->tangents[vertex] = w.tangent;
    mesh->triangles[w.corner] = vertex;
  }
  if (from.size() > mesh->positions.size()) TakeVertices(from, mesh);
}

}  // namespace

void GenerateTangents(const TextureRef& normal_texture, Mesh* mesh) {
  const int set = normal_texture.uv_set;
  if (mesh->uvs[set].empty()) return;
  std::vector<Vec3> face_normals;
  if (mesh->normals.empty()) face_normals = SplitFaces(mesh);
  const std::vector<Vec3> normals = mesh->normals.empty() ? std::move(face_normals) : mesh->normals;
  const std::vector<Vec2> uvs = UpwardUvs(normal_texture, mesh->uvs[set]);
  TangentBuilder builder(*mesh, normals, uvs);
  builder.Run();
  AssignTangents(builder, mesh);
}

}  // namespace lumifold::scene
