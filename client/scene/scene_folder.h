#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::client {

/// Which files a scene may name. A scene is not trusted: it may come from anyone.
struct SceneFileRules {
  /// Folders besides the scene's own whose files it may name. A relative path is relative to the working
  /// folder.
  std::vector<std::string> allowed_folders = {};
  /// Limits of one file, and of all files of a job. Assets are held in memory by workers; a coordinator has
  /// limits of its own.
  uint64_t max_file_bytes = uint64_t{4} << 30;
  uint64_t max_job_bytes = uint64_t{64} << 30;
};

/// Whether a scene may call a file so: a relative path in UTF-8 without control characters, of at most 1024
/// bytes, with neither backslashes nor a drive letter. Errors: kDataLoss with the cause, without the name.
absl::Status CheckFileName(const std::string& name);

/// Text of a scene for an error message: one line without control characters, of at most about 100
/// characters.
std::string Shown(const std::string& text);

/// Opens a file that the user named. Folders, devices, FIFOs and sockets are never opened, not even for a
/// moment.
/// Errors: kNotFound, kInvalidArgument for what is no regular file, and others of the system, naming the
/// path.
absl::StatusOr<rpc::FileHandle> OpenRegularFile(const std::string& path);

/// How a path is kept inside a folder: by the kernel, or, where it has no openat2(2) (before Linux 5.6),
/// component by component, with all links refused.
enum class Containment { kOfKernel, kByComponents };

/// The folder of a scene, and the others whose files the scene may name. What is opened is what was checked:
/// there is no moment between them in which a link could be put in place of a file.
/// Threads: safe concurrently.
class SceneFolder {
 public:
  /// The folder of the scene file at `scene_path`.
  /// Errors: those of the system, naming the folder.
  static absl::StatusOr<SceneFolder> Open(const std::string& scene_path,
                                          const std::vector<std::string>& allowed_folders,
                                          Containment containment = Containment::kOfKernel);

  /// Opens the regular file `name`, a path relative to the folder. Neither ".." nor links lead out of the
  /// folder and the allowed ones.
  /// Errors: kPermissionDenied for a file outside; kDataLoss as CheckFileName; those of OpenRegularFile.
  absl::StatusOr<rpc::FileHandle> OpenFile(const std::string& name) const;

  /// The path of a file, for messages.
  std::string PathOf(const std::string& name) const;

 private:
  struct Folder {
    std::string path;  // without links
    rpc::FileHandle handle;
  };
  static absl::StatusOr<Folder> OpenFolder(const std::string& path);

  std::string path_;  // as the user wrote it; empty: the working folder
  Folder own_;
  std::vector<Folder> allowed_;
  Containment containment_ = Containment::kOfKernel;
};

}  // namespace lumifold::client
