#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "absl/types/span.h"

namespace lumifold {

/// The system calls that change files. All durable files are written through it, so that a test can make any
/// call fail, or end the machine at it. Files are read and closed by the system's own calls.
/// Errors: every call returns a value below 0 on failure: minus the error number (errno). Interrupted calls
/// are repeated.
/// Threads: safe.
class FileSystem {
 public:
  virtual ~FileSystem() = default;

  /// Whether its files are for their owner alone: they take no mode of another file, and follow no link.
  virtual bool IsPrivate() const { return false; }

  /// open(2), close-on-exec. Returns the descriptor, which the caller closes. The implementation
  /// decides the mode of new files and folders.
  virtual int Open(const std::string& path, int flags) = 0;
  /// Writes all of the pieces one after the other, the first at `offset`. After an error any part of them may
  /// be written.
  virtual int Write(int file, uint64_t offset, absl::Span<const std::string_view> pieces) = 0;
  virtual int Truncate(int file, uint64_t size) = 0;
  /// Makes the file `size` bytes long and reserves its space on the disk.
  virtual int Allocate(int file, uint64_t size) = 0;
  /// Waits until the content of the file is on the disk. Its name is durable after SyncFolder only.
  virtual int Sync(int file) = 0;
  /// Waits until the names in the folder are on the disk.
  virtual int SyncFolder(const std::string& folder) = 0;
  virtual int Rename(const std::string& from, const std::string& to) = 0;
  /// Removes a file or an empty folder.
  virtual int Remove(const std::string& path) = 0;
  /// Creates a folder if it does not exist; its parent exists.
  virtual int MakeFolder(const std::string& path) = 0;
};

/// The file system of this machine. New files get mode 0666 and new folders 0777, less the umask.
FileSystem* RealFileSystem();

/// The same for files that only their owner may read: modes 0600 and 0700.
FileSystem* PrivateFileSystem();

/// The folder of a file, for SyncFolder.
std::string FolderOf(const std::string& path);

/// `path` with `suffix` behind its name, which is cut where file systems would not take the whole.
std::string NameBeside(const std::string& path, std::string_view suffix);

/// The file that is written under the name `path`: what it links to, if it is a symbolic link.
std::string FileBehind(const std::string& path);

}  // namespace lumifold
