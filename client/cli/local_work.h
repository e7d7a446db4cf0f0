#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/scene/assets.h"
#include "filter/image/film_source.h"
#include "filter/image/layered_image.h"
#include "lumifold/v1/job.pb.h"

namespace grpc {
class Channel;
}  // namespace grpc

/// What commands do in their own process and not at a farm. The program passes these functions in
/// (client/local), so that the client links neither coordinator nor renderer nor filter.
namespace lumifold::client {

/// A coordinator and a worker inside this process. Its destruction stops both and removes temporary files.
class LocalFarm {
 public:
  virtual ~LocalFarm() = default;

  /// A channel to its coordinator; valid until the farm is destroyed.
  virtual std::shared_ptr<grpc::Channel> channel() = 0;
  /// What went wrong and was no error, a line each.
  virtual std::vector<std::string> Warnings() { return {}; }
};

struct LocalFarmOptions {
  /// Render threads, at least 1.
  int threads = 1;
  /// Data folder of the coordinator; empty for a temporary folder that is removed with the farm.
  std::string state_dir;
  /// As those of FilterMachine.
  std::string device = "auto";
  bool allows_other_bits = false;
};

/// Starts a local farm.
using LocalFarmFactory =
    std::function<absl::StatusOr<std::unique_ptr<LocalFarm>>(const LocalFarmOptions& options)>;

/// Plans a job by its first frame: `spec` names the scene, `assets` are its files.
/// Errors: those of worker::LoadJobScene and worker::PlanJob.
using ScenePlanner =
    std::function<absl::StatusOr<v1::Plan>(const v1::JobSpec& spec, const SceneAssets& assets)>;

/// Whether a worker would take a job's scene, but for what is in its pictures; scenes of more than 1 GiB are
/// taken.
/// Errors: those of worker::CheckJobScene.
using SceneCheck = std::function<absl::Status(const v1::JobSpec& spec, const SceneAssets& assets)>;

/// What is in a scene's file.
struct SceneFacts {
  std::vector<std::string> cameras;  // names, by number; so are those of the next two
  std::vector<std::string> animations;
  std::vector<std::string> variants;
  std::vector<std::string> lights;  // punctual ones
  std::vector<std::string> extensions;
  std::vector<std::string> warnings;
  double animation_seconds = 0;
  int64_t triangles = 0;
  int64_t instances = 0;
  int64_t materials = 0;
  int64_t textures = 0;
  int64_t texture_pixels = 0;
  int64_t memory_bytes = 0;  // an estimate
};

/// Reads a scene's file. Errors: those of scene::LoadGltfFile.
using SceneReader = std::function<absl::StatusOr<SceneFacts>(const std::string& path)>;

/// Reads a .png or .jpg as linear light: channels R, G and B.
/// Errors: kNotFound for a missing file; kDataLoss for one that is no such picture.
using DisplayedReader = std::function<absl::StatusOr<LayeredImage>(const std::string& path)>;

/// What filters: `threads` of the processor, and a device beside it.
struct FilterMachine {
  int threads = 1;
  /// Those of filter::DeviceChoice.
  std::string device = "auto";
  bool allows_other_bits = false;
  /// Receives a line about a device that fails.
  std::function<void(const std::string& line)> warn = [](const std::string&) {};
};

/// Filters a film (channels of filter/image/layers.h) with `method`. Passes R G B and the channels named in
/// `passed_on` to `sink`, in bands of rows from the top down. For a film without halves, halves are made from
/// its one picture. `progress` is told the share that is done, between reads.
/// Errors: those of filter::FilterFilmInRows and device::OpenDevice.
using FilmFilter =
    std::function<absl::Status(FilmSource* film, const std::string& method, const FilterMachine& machine,
                               const std::vector<std::string>& passed_on, const RowSink& sink,
                               const std::function<void(double share)>& progress)>;

/// A device that may filter, as filter::DeviceInfo has it.
struct DeviceFacts {
  std::string name;
  std::string driver;
  bool is_gpu = false;
  uint64_t memory_bytes = 0;
  std::string refusal;     // why it does not filter; empty: it does
  std::string other_bits;  // why it does so on request alone; empty: it gives the processor's bits
};
/// The devices of this machine by number. Errors: kFailedPrecondition: it has no OpenCL.
using DeviceLister = std::function<absl::StatusOr<std::vector<DeviceFacts>>()>;

/// What the commands print about the filter's methods, made from filter::Methods().
struct MethodTexts {
  std::string names;  // "a, b and c"
  std::string table;  // summary, source and parameters of each, for people
  std::string json;   // the same, one JSON object a line
};

}  // namespace lumifold::client
