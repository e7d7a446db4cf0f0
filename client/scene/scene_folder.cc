#include "client/scene/scene_folder.h"

#include <fcntl.h>
#include <linux/openat2.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace lumifold::client {
namespace {

namespace fs = std::filesystem;

/// The job's limit of an asset's name.
constexpr size_t kMaxNameBytes = 1024;
constexpr size_t kShownBytes = 100;

/// A handle that names a file but does not open it: devices and FIFOs do not notice.
constexpr int kNameOnly = O_PATH | O_CLOEXEC;

absl::Status SystemError(const std::string& path, int error) {
  return {absl::ErrnoToStatusCode(error), absl::StrCat(path, ": ", std::strerror(error))};
}

/// The next character of UTF-8 text, which is valid.
uint32_t TakeCharacter(absl::string_view* text) {
  const auto byte = static_cast<unsigned char>(text->front());
  const int more = byte < 0xc0 ? 0 : byte < 0xe0 ? 1 : byte < 0xf0 ? 2 : 3;
  uint32_t character = more == 0 ? byte : byte & (0x3fU >> more);
  for (int i = 1; i <= more && static_cast<size_t>(i) < text->size(); ++i) {
    character = (character << 6) | (static_cast<unsigned char>((*text)[static_cast<size_t>(i)]) & 0x3fU);
  }
  text->remove_prefix(std::min(text->size(), static_cast<size_t>(more) + 1));
  return character;
}

/// Control characters, and those that make a terminal show a text in another order or on another line.
bool IsControl(uint32_t character) {
  return character < 0x20 || (character >= 0x7f && character < 0xa0) ||
         (character >= 0x2028 && character <= 0x202e) || (character >= 0x2066 && character <= 0x2069);
}

bool HasControl(absl::string_view text) {
  while (!text.empty()) {
    if (IsControl(TakeCharacter(&text))) return true;
  }
  return false;
}

const char* KindOf(mode_t mode) {
  if (S_ISDIR(mode)) return "a folder";
  if (S_ISFIFO(mode)) return "a FIFO";
  if (S_ISSOCK(mode)) return "a socket";
  return S_ISCHR(mode) || S_ISBLK(mode) ? "a device" : "a link";
}

/// Opens the file that `name_only` names, if it is a regular one.
absl::StatusOr<rpc::FileHandle> OpenNamed(const rpc::FileHandle& name_only, const std::string& path) {
  struct stat info = {};
  if (fstat(name_only.get(), &info) != 0) return SystemError(path, errno);
  if (!S_ISREG(info.st_mode)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": is ", KindOf(info.st_mode), ", not a file"));
  }
  const std::string same = absl::StrCat("/proc/self/fd/", name_only.get());
  rpc::FileHandle file(open(same.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY));
  if (file.get() < 0) return SystemError(path, errno);
  return file;
}

/// A name-only handle of `name` below `folder`, or minus the error number; EXDEV where it leads out.
int FindBelowByKernel(int folder, const std::string& name) {
  open_how how = {};
  how.flags = kNameOnly;
  how.resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS;
  while (true) {
    const long file = syscall(SYS_openat2, folder, name.c_str(), &how, sizeof(how));
    if (file >= 0) return static_cast<int>(file);
    // EAGAIN: someone renamed a folder meanwhile, and the kernel cannot say whether the path stayed inside.
    if (errno != EINTR && errno != EAGAIN) return -errno;
  }
}

/// The same with openat(2). Links are taken for ways out.
int FindBelowByComponents(int folder, const std::string& name) {
  rpc::FileHandle current(fcntl(folder, F_DUPFD_CLOEXEC, 0));
  if (current.get() < 0) return -errno;
  for (const std::string& part : std::vector<std::string>(absl::StrSplit(name, '/', absl::SkipEmpty()))) {
    if (part == "..") return -EXDEV;
    rpc::FileHandle next(openat(current.get(), part.c_str(), kNameOnly | O_NOFOLLOW));
    if (next.get() < 0) return -errno;
    struct stat info = {};
    if (fstat(next.get(), &info) != 0) return -errno;
    if (S_ISLNK(info.st_mode)) return -EXDEV;
    current = std::move(next);
  }
  const int file = fcntl(current.get(), F_DUPFD_CLOEXEC, 0);
  return file >= 0 ? file : -errno;
}

int FindBelow(int folder, const std::string& name, Containment containment) {
  if (containment == Containment::kOfKernel) {
    const int file = FindBelowByKernel(folder, name);
    // Some container engines answer EPERM to calls that they do not know.
    if (file != -ENOSYS && file != -EPERM) return file;
  }
  return FindBelowByComponents(folder, name);
}

}  // namespace

std::string Shown(const std::string& text) {
  const std::string plain = HasControl(text) ? absl::CHexEscape(text) : text;
  return plain.size() <= kShownBytes ? plain : absl::StrCat(plain.substr(0, kShownBytes), "...");
}

absl::Status CheckFileName(const std::string& name) {
  const auto refuse = [](absl::string_view why) { return absl::DataLossError(why); };
  if (name.empty()) return refuse("it is empty");
  if (name.size() > kMaxNameBytes) return refuse(absl::StrCat("it has more than ", kMaxNameBytes, " bytes"));
  if (HasControl(name)) return refuse("it has control characters");
  if (name.front() == '/') return refuse("absolute paths are not followed");
  if (absl::StrContains(name, '\\')) return refuse("it has a backslash; glTF separates folders by '/'");
  if (name.size() > 1 && name[1] == ':' && absl::ascii_isalpha(static_cast<unsigned char>(name[0])))
    return refuse("it begins with a drive letter");
  return absl::OkStatus();
}

absl::StatusOr<rpc::FileHandle> OpenRegularFile(const std::string& path) {
  const rpc::FileHandle name_only(open(path.c_str(), kNameOnly));
  if (name_only.get() < 0) return SystemError(path, errno);
  return OpenNamed(name_only, path);
}

absl::StatusOr<SceneFolder::Folder> SceneFolder::OpenFolder(const std::string& path) {
  std::error_code error;
  Folder folder;
  folder.path = fs::canonical(path, error).string();
  if (error) return SystemError(path, error.value());
  folder.handle = rpc::FileHandle(open(folder.path.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
  if (folder.handle.get() < 0) return SystemError(path, errno);
  return folder;
}

absl::StatusOr<SceneFolder> SceneFolder::Open(const std::string& scene_path,
                                              const std::vector<std::string>& allowed_folders,
                                              Containment containment) {
  SceneFolder scene;
  scene.containment_ = containment;
  scene.path_ = fs::path(scene_path).parent_path().string();
  absl::StatusOr<Folder> own = OpenFolder(scene.path_.empty() ? "." : scene.path_);
  if (!own.ok()) return own.status();
  scene.own_ = *std::move(own);
  for (const std::string& path : allowed_folders) {
    absl::StatusOr<Folder> folder = OpenFolder(path);
    if (!folder.ok())
      return absl::Status(folder.status().code(), absl::StrCat("--allow-dir ", folder.status().message()));
    scene.allowed_.push_back(*std::move(folder));
  }
  return scene;
}

std::string SceneFolder::PathOf(const std::string& name) const { return (fs::path(path_) / name).string(); }

absl::StatusOr<rpc::FileHandle> SceneFolder::OpenFile(const std::string& name) const {
  if (absl::Status status = CheckFileName(name); !status.ok()) return status;
  const std::string path = PathOf(name);
  int found = FindBelow(own_.handle.get(), name, containment_);
  if (found == -EXDEV) {
    // Where the path leads is found first, and then opened below the allowed folder, links refused or not: if
    // someone changes it meanwhile, the second step still does not leave that folder.
    std::error_code error;
    const fs::path target = fs::canonical(fs::path(own_.path) / name, error);
    for (const Folder& folder : allowed_) {
      const fs::path below = error ? fs::path() : target.lexically_relative(folder.path);
      if (found != -EXDEV || below.empty() || *below.begin() == "..") continue;
      found = FindBelow(folder.handle.get(), below.string(), containment_);
    }
    if (error && !allowed_.empty()) return SystemError(path, error.value());
  }
  if (found == -EXDEV) {
    return absl::PermissionDeniedError(
        absl::StrCat(path, ": is outside the scene's folder; --allow-dir DIR allows another folder"));
  }
  if (found < 0) return SystemError(path, -found);
  return OpenNamed(rpc::FileHandle(found), path);
}

}  // namespace lumifold::client
