#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/cli/command_line.h"
#include "client/cli/environment.h"
#include "client/cli/exit_code.h"
#include "client/cli/frame_range.h"
#include "client/cli/picture_size.h"
#include "client/scene/assets.h"
#include "filter/image/rect.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// Maximum number of samples per pixel.
inline constexpr int kMaxSamples = 1 << 20;

/// With --target-error or --time, but without --spp.
inline constexpr int kMostSamplesByDefault = 4096;

/// What of the scene the pictures show.
struct ViewOptions {
  PictureSize size;
  std::optional<Rect> region;        // nothing: the whole frame
  std::string pixel_filter = "box";  // kPixelFilters
  float pixel_filter_width = 0;      // 0: the filter's own
  std::string camera;
  std::string animation;  // empty: all that fit together
  std::string variant;    // empty: none
  Frames frames;
  float frames_per_second = 24;
};

struct SamplingOptions {
  int samples_per_pixel = 0;  // 0: 64, or with an error or a time kMostSamplesByDefault
  bool adaptive = false;
  float target_error = 0;  // 0: none
  std::string target_metric = "mse255";
  std::string time;      // "10m"; empty: none
  std::string schedule;  // "32,64.5"; empty: none
  uint64_t seed = 0;
  int max_bounces = 8;
};

struct EnvironmentMapOptions {
  std::string path;  // empty: none
  float rotate_degrees = 0;
  float scale = 1;
};

struct LensOptions {
  float f_stop = 0;  // 0: pinhole camera
  float focus_metres = 0;
};

/// See SceneFileRules.
struct SceneFileOptions {
  std::vector<std::string> allowed_folders;
  int max_file_mb = 4096;
  int max_job_mb = 65536;
};

/// What is behind and below the scene.
struct BackdropOptions {
  std::string background = "environment";  // or "transparent"
  std::string ground = "none";             // or "shadow"
};

/// What the result has besides the picture.
struct ResultOptions {
  bool save_film = false;
  bool cryptomatte = false;
};

struct PlanningOptions {
  std::string mode = "auto";        // or "full"
  std::vector<std::string> forced;  // "NAME=VALUE": decisions to override
};

/// Options of `render`, `submit` and `plan`: all parameters that determine the picture.
struct JobOptions {
  std::string scene;
  std::string job_file;  // read by CommandLine::Parse
  ViewOptions view;
  SamplingOptions sampling;
  std::string method = "default";
  EnvironmentMapOptions environment;
  BackdropOptions backdrop;
  LensOptions lens;
  SceneFileOptions files;
  ResultOptions result;
  PlanningOptions planning;
};

/// Adds SCENE and the options above to a command.
void AddJobOptions(CommandLine& command_line, JobOptions* options);

/// Sets the height of a size that has none, by the scene's camera, and checks combinations of options. For an
/// invalid one it prints an error to `err` and returns the exit code.
std::optional<ExitCode> CheckJobOptions(const std::string& command, const Environment& environment,
                                        JobOptions* options);

/// The files of the job: those of its scene and its environment map, with size and SHA-256.
/// Errors: those of FindSceneAssets() and HashAssets().
absl::StatusOr<SceneAssets> FindJobAssets(const JobOptions& options);

/// The job's spec, without the scene.
v1::JobSpec MakeJobSpec(const JobOptions& options);

}  // namespace lumifold::client
