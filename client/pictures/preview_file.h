#pragma once

#include <memory>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "client/farm/farm_client.h"
#include "client/pictures/display_file.h"
#include "filter/image/layered_image.h"
#include "proto/threads/event.h"

namespace lumifold::client {

struct PreviewFileOptions {
  std::string job_id;
  int frame = 0;
  /// As of PictureFormatOf. Whoever reads the file meanwhile reads a whole picture.
  std::string path;
  pictures::DisplayOptions display = {};
};

/// Keeps a file up to date with the preview of a frame, on a thread of its own, until the frame is finished.
class PreviewFile {
 public:
  PreviewFile(std::unique_ptr<FarmClient> farm, PreviewFileOptions options);
  ~PreviewFile() { Stop().IgnoreError(); }

  /// Ends the thread, after a call of the farm that it is in. Returns what kept it from writing further
  /// previews: errors of the file, of the job, and of a coordinator that knows no previews; not that one
  /// could not be reached.
  absl::Status Stop();

 private:
  absl::Status Run();
  absl::Status Write(const v1::Preview& preview) const;
  /// Writes it for a display.
  absl::Status Show(const std::string& path, const LayeredImage& picture) const;

  const std::unique_ptr<FarmClient> farm_;
  const PreviewFileOptions options_;
  threads::Event stop_;
  absl::Status result_;  // of the thread, once it has ended
  std::thread thread_;   // last: it uses the members above
};

}  // namespace lumifold::client
