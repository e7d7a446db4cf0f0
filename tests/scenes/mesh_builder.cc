#include "tests/scenes/mesh_builder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>
#include <tuple>

#include "tests/scenes/noise.h"

namespace lumifold::scenes {
namespace {

constexpr double kPi = std::numbers::pi;

std::uint32_t AddVertex(Mesh& mesh, Vec3 position, Vec3 normal, Vec2 uv) {
  mesh.positions.push_back(position);
  mesh.normals.push_back(normal);
  mesh.uvs.push_back(uv);
  return static_cast<std::uint32_t>(mesh.positions.size() - 1);
}

Vec3 AreaNormal(const Mesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  return Cross(mesh.positions[b] - mesh.positions[a], mesh.positions[c] - mesh.positions[a]);
}

/// Leaves out degenerate triangles, which occur at poles.
void AddTriangle(Mesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  constexpr double kNoArea = 1e-10;
  if (Length(AreaNormal(mesh, a, b, c)) < kNoArea) return;
  mesh.indices.insert(mesh.indices.end(), {a, b, c});
}

/// Two triangles for every cell of a row-major grid of vertices that starts at `first`.
void AddGridTriangles(Mesh& mesh, std::uint32_t first, int columns, int rows) {
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const std::uint32_t a = first + static_cast<std::uint32_t>(row * (columns + 1) + column);
      const std::uint32_t b = a + static_cast<std::uint32_t>(columns + 1);
      AddTriangle(mesh, a, a + 1, b + 1);
      AddTriangle(mesh, a, b + 1, b);
    }
  }
}

/// Area-weighted normals for the grid of vertices that starts at `first`; coincident vertices get one normal.
/// A cell is weighted as a whole, by its diagonals; by triangles the shared corners would get more weight.
void SmoothGridNormals(Mesh& mesh, std::size_t first, int columns, int rows) {
  using Key = std::tuple<std::int64_t, std::int64_t, std::int64_t>;
  const auto key = [&](std::size_t vertex) {
    constexpr double kPerMetre = 1e6;
    const Vec3 p = mesh.positions[vertex];
    return Key{std::llround(p.x * kPerMetre), std::llround(p.y * kPerMetre), std::llround(p.z * kPerMetre)};
  };
  std::map<Key, Vec3> sums;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const std::size_t a = first + static_cast<std::size_t>(row * (columns + 1) + column);
      const std::size_t b = a + static_cast<std::size_t>(columns + 1);
      const Vec3 normal = Normalized(
          Cross(mesh.positions[b + 1] - mesh.positions[a], mesh.positions[b] - mesh.positions[a + 1]));
      for (const std::size_t corner : {a, a + 1, b, b + 1}) sums[key(corner)] = sums[key(corner)] + normal;
    }
  }
  for (std::size_t vertex = first; vertex < mesh.positions.size(); ++vertex) {
    const Vec3 sum = sums[key(vertex)];
    mesh.normals[vertex] = sum == Vec3{} ? Vec3{0, 1, 0} : Normalized(sum);
  }
}

/// One side of a rounded box: the flat part, and around it 45 degrees of each adjacent edge.
void AddRoundedSide(Mesh& mesh, Vec3 center, Vec3 inner, double radius, int steps,
                    const std::array<Vec3, 3>& axes) {
  const auto [u_axis, v_axis, n_axis] = axes;
  const std::uint32_t first = static_cast<std::uint32_t>(mesh.positions.size());
  const int points = 2 * (steps + 1);
  // Points left of the middle belong to the left edge, the others to the right edge, with the flat part
  // between.
  const auto side = [&](int i) { return i <= steps ? -1.0 : 1.0; };
  const auto slope = [&](int i) {
    return std::tan(Radians(45.0 * (i <= steps ? i - steps : i - steps - 1) / steps));
  };
  for (int row = 0; row < points; ++row) {
    for (int column = 0; column < points; ++column) {
      const Vec3 normal = Normalized(n_axis + u_axis * slope(column) + v_axis * slope(row));
      const Vec3 corner = (u_axis * side(column) + v_axis * side(row) + n_axis) * inner;
      const Vec3 local = corner + normal * radius;
      AddVertex(mesh, center + local, normal, {Dot(local, u_axis), Dot(local, v_axis)});
    }
  }
  AddGridTriangles(mesh, first, points - 1, points - 1);
}

// The sides of a box: two tangents and the normal, right-handed.
constexpr std::array<std::array<Vec3, 3>, 6> kBoxSides = {{
    {{{0, 0, -1}, {0, 1, 0}, {1, 0, 0}}},
    {{{0, 0, 1}, {0, 1, 0}, {-1, 0, 0}}},
    {{{1, 0, 0}, {0, 0, -1}, {0, 1, 0}}},
    {{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}},
    {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}},
    {{{-1, 0, 0}, {0, 1, 0}, {0, 0, -1}}},
}};

/// One stretch of a lathe's profile without hard edges.
void AddSmoothLathe(Mesh& mesh, Vec3 base, std::span<const Vec2> run, int segments) {
  std::vector<double> along = {0};
  double widest = 0;
  for (std::size_t i = 0; i < run.size(); ++i) {
    if (i > 0) along.push_back(along.back() + Length(run[i] - run[i - 1]));
    widest = std::max(widest, run[i].x);
  }
  const int rows = static_cast<int>(run.size()) - 1;
  AddSurface(mesh, segments, rows, {2 * kPi * widest, along.back()}, [&](double u, double v) {
    const Vec2 p = run[static_cast<std::size_t>(std::lround(v * rows))];
    // The last column must equal the first one exactly, so that the seam shares its normals.
    const double angle = u == 1 ? 0 : -2 * kPi * u;
    return base + Vec3{p.x * std::cos(angle), p.y, p.x * std::sin(angle)};
  });
}

}  // namespace

void AddQuad(Mesh& mesh, Vec3 corner, Vec3 edge_u, Vec3 edge_v) {
  const Vec3 normal = Normalized(Cross(edge_u, edge_v));
  const double width = Length(edge_u);
  const double height = Length(edge_v);
  const std::uint32_t first = AddVertex(mesh, corner, normal, {0, 0});
  AddVertex(mesh, corner + edge_u, normal, {width, 0});
  AddVertex(mesh, corner + edge_v, normal, {0, height});
  AddVertex(mesh, corner + edge_u + edge_v, normal, {width, height});
  AddGridTriangles(mesh, first, 1, 1);
}

void AddFlatPolygon(Mesh& mesh, std::span<const Vec3> corners) {
  const Vec3 u_axis = Normalized(corners[1] - corners[0]);
  const Vec3 normal = Normalized(Cross(u_axis, corners.back() - corners[0]));
  const Vec3 v_axis = Cross(normal, u_axis);
  const std::uint32_t first = static_cast<std::uint32_t>(mesh.positions.size());
  for (const Vec3& p : corners) {
    AddVertex(mesh, p, normal, {Dot(p - corners[0], u_axis), Dot(p - corners[0], v_axis)});
  }
  for (std::uint32_t i = 2; i < corners.size(); ++i) AddTriangle(mesh, first, first + i - 1, first + i);
}

void AddBox(Mesh& mesh, Vec3 center, Vec3 size) {
  for (const auto& [u_axis, v_axis, n_axis] : kBoxSides) {
    const Vec3 corner = center + (n_axis - u_axis - v_axis) * size * 0.5;
    AddQuad(mesh, corner, u_axis * size, v_axis * size);
  }
}

void AddRoundedBox(Mesh& mesh, Vec3 center, Vec3 size, double radius, int steps) {
  const Vec3 inner = size * 0.5 - Vec3{radius, radius, radius};
  for (const auto& axes : kBoxSides) AddRoundedSide(mesh, center, inner, radius, steps, axes);
}

void AddSurface(Mesh& mesh, int columns, int rows, Vec2 uv_size,
                const std::function<Vec3(double u, double v)>& point) {
  const std::size_t first_vertex = mesh.positions.size();
  for (int row = 0; row <= rows; ++row) {
    for (int column = 0; column <= columns; ++column) {
      const double u = static_cast<double>(column) / columns;
      const double v = static_cast<double>(row) / rows;
      AddVertex(mesh, point(u, v), {}, {u * uv_size.x, v * uv_size.y});
    }
  }
  AddGridTriangles(mesh, static_cast<std::uint32_t>(first_vertex), columns, rows);
  SmoothGridNormals(mesh, first_vertex, columns, rows);
}

void AddLathe(Mesh& mesh, Vec3 base, std::span<const Vec2> profile, int segments) {
  std::size_t start = 0;
  for (std::size_t i = 1; i <= profile.size(); ++i) {
    const bool hard_edge = i < profile.size() && Length(profile[i] - profile[i - 1]) == 0;
    if (!hard_edge && i < profile.size()) continue;
    if (i - start > 1) AddSmoothLathe(mesh, base, profile.subspan(start, i - start), segments);
    start = i;
  }
}

void AddCylinder(Mesh& mesh, Vec3 base, double bottom_radius, double top_radius, double height,
                 int segments) {
  const Vec2 bottom = {bottom_radius, 0};
  const Vec2 top = {top_radius, height};
  const Vec2 profile[] = {{0, 0}, bottom, bottom, top, top, {0, height}};
  AddLathe(mesh, base, profile, segments);
}

void AddSphere(Mesh& mesh, Vec3 center, double radius, int segments) {
  std::vector<Vec2> profile;
  for (int i = 0; i <= segments / 2; ++i) {
    const double angle = kPi * i / (segments / 2);
    const bool pole = i == 0 || i == segments / 2;
    profile.push_back({pole ? 0 : radius * std::sin(angle), -radius * std::cos(angle)});
  }
  AddLathe(mesh, center, profile, segments);
}

void AddTube(Mesh& mesh, std::span<const Vec3> path, double radius, int segments) {
  const std::size_t last = path.size() - 1;
  const auto direction = [&](std::size_t i) {
    return Normalized(path[std::min(i + 1, last)] - path[i == 0 ? 0 : i - 1]);
  };
  // Parallel transport: the frame rotates as little as possible along the path, so the rod does not twist.
  std::vector<Vec3> sides;
  const Vec3 start = direction(0);
  Vec3 side = Normalized(Cross(start, std::fabs(start.y) < 0.9 ? Vec3{0, 1, 0} : Vec3{1, 0, 0}));
  double length = 0;
  for (std::size_t i = 0; i <= last; ++i) {
    side = Normalized(side - direction(i) * Dot(side, direction(i)));
    sides.push_back(side);
    if (i > 0) length += Length(path[i] - path[i - 1]);
  }
  AddSurface(mesh, segments, static_cast<int>(last), {2 * kPi * radius, length}, [&](double u, double v) {
    const std::size_t i = static_cast<std::size_t>(std::lround(v * static_cast<double>(last)));
    const double angle = u == 1 ? 0 : 2 * kPi * u;
    const Vec3 across = Cross(direction(i), sides[i]);
    return path[i] + (sides[i] * std::cos(angle) + across * std::sin(angle)) * radius;
  });
}

std::vector<Vec3> RoundedPath(std::span<const Vec3> corners, double radius) {
  constexpr int kSteps = 6;
  std::vector<Vec3> path = {corners.front()};
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) {
    const Vec3 before = corners[i] + Normalized(corners[i - 1] - corners[i]) * radius;
    const Vec3 after = corners[i] + Normalized(corners[i + 1] - corners[i]) * radius;
    for (int step = 0; step <= kSteps; ++step) {
      const double t = static_cast<double>(step) / kSteps;
      path.push_back(Mix(Mix(before, corners[i], t), Mix(corners[i], after, t), t));
    }
  }
  path.push_back(corners.back());
  return path;
}

void AddArchWall(Mesh& mesh, const ArchShape& arch) {
  const double half = arch.width / 2;
  const std::size_t first = mesh.positions.size();
  const double front = arch.thickness / 2;
  std::vector<Vec3> rim;  // along the opening's edge, from its left foot to its right foot
  rim.push_back({-arch.radius, 0, front});
  for (int i = 0; i <= arch.segments; ++i) {
    const double angle = kPi * (1 - static_cast<double>(i) / arch.segments);
    rim.push_back({arch.radius * std::cos(angle), arch.spring_height + arch.radius * std::sin(angle), front});
  }
  rim.push_back({arch.radius, 0, front});
  const Vec3 back = {0, 0, -arch.thickness};
  for (std::size_t i = 2; i + 1 < rim.size(); ++i) {
    const Vec3 a = rim[i - 1], b = rim[i];
    const Vec3 top_a = {a.x, arch.height, front}, top_b = {b.x, arch.height, front};
    AddFlatPolygon(mesh, std::array{a, b, top_b, top_a});
    AddFlatPolygon(mesh, std::array{b + back, a + back, top_a + back, top_b + back});
  }
  const double pier = half - arch.radius;
  for (const double left : {-half, arch.radius}) {
    AddQuad(mesh, {left, 0, front}, {pier, 0, 0}, {0, arch.height, 0});
    AddQuad(mesh, {left + pier, 0, -front}, {-pier, 0, 0}, {0, arch.height, 0});
  }
  // The faces' texture is continuous across their strips.
  for (std::size_t i = first; i < mesh.uvs.size(); ++i) {
    mesh.uvs[i] = {mesh.positions[i].x + half, mesh.positions[i].y};
  }
  const int steps = static_cast<int>(rim.size()) - 1;
  AddSurface(mesh, 1, steps, {arch.thickness, kPi * arch.radius}, [&](double u, double v) {
    return rim[static_cast<std::size_t>(std::lround(v * steps))] + back * u;
  });
}

void AddCushion(Mesh& mesh, Vec3 size, unsigned seed) {
  constexpr int kCells = 40;
  for (const double side : {1.0, -1.0}) {
    AddSurface(mesh, kCells, kCells, {size.x, size.z}, [&](double u, double v) {
      // Sines space the grid more closely near the hem, where the cushion curves most.
      const double a = std::sin((u - 0.5) * kPi);
      const double b = std::sin((v - 0.5) * kPi) * -side;
      const double puff = std::sqrt(std::sqrt(std::fmax(0, (1 - a * a) * (1 - b * b))));
      const double crease = Fbm({a * 2.5, b * 2.5}, 3, seed) - 0.5;
      const double pinch_x = 1 - 0.09 * (1 - b * b), pinch_z = 1 - 0.09 * (1 - a * a);
      const double height = size.y / 2 * puff * (0.92 + 0.35 * crease * puff);
      return Vec3{a * pinch_x * size.x / 2, size.y / 2 + side * height, b * pinch_z * size.z / 2};
    });
  }
}

void AddMoved(Mesh& mesh, const Mesh& part, const Transform& transform) {
  const std::uint32_t first = static_cast<std::uint32_t>(mesh.positions.size());
  for (std::size_t i = 0; i < part.positions.size(); ++i) {
    AddVertex(mesh, transform.Point(part.positions[i]), transform.Normal(part.normals[i]), part.uvs[i]);
  }
  for (const std::uint32_t index : part.indices) mesh.indices.push_back(first + index);
}

}  // namespace lumifold::scenes
