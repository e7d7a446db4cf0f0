#include "server/storage/folder_contents.h"

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "filter/image/file_io.h"

namespace lumifold::server {
namespace {

namespace fs = std::filesystem;

struct FrameFile {
  int32_t frame = 0;
  fs::path path;
};

/// The files of frames in a folder, frame-NNNN, perhaps a writer, and the suffix; by name.
std::vector<FrameFile> FrameFilesIn(const std::string& folder, const char* suffix) {
  std::vector<FrameFile> files;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().stem().string();
    if (entry->path().extension() != suffix || !name.starts_with(DataFolder::kFramePrefix)) continue;
    const size_t first = std::strlen(DataFolder::kFramePrefix);
    int32_t frame = 0;
    if (absl::SimpleAtoi(name.substr(first, name.find('.', first) - first), &frame))
      files.push_back({frame, entry->path()});
  }
  std::sort(files.begin(), files.end(),
            [](const FrameFile& a, const FrameFile& b) { return a.path < b.path; });
  return files;
}

std::vector<job::JobId> NamesIn(const std::string& path) {
  std::vector<job::JobId> names;
  std::error_code error;
  for (fs::directory_iterator entry(path, error), end; !error && entry != end; entry.increment(error))
    names.emplace_back(entry->path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

absl::Status RemovePartialFiles(const std::vector<std::string>& folders, FileSystem* files) {
  // Results and manifests that still have their temporary name are incomplete.
  std::vector<std::string> partial;
  for (const std::string& folder : folders) {
    std::error_code error;
    for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end;
         entry.increment(error)) {
      if (entry->path().extension() == kPartialSuffix) partial.push_back(entry->path().string());
    }
    if (error && error != std::errc::no_such_file_or_directory)
      return absl::UnavailableError(absl::StrCat(folder, ": ", error.message()));
  }
  for (const std::string& path : partial) {
    if (absl::Status status = RemoveAll(path, files); !status.ok()) return status;
  }
  return absl::OkStatus();
}

}  // namespace

std::vector<job::JobId> JobsWithFilm(const DataFolder& folder) { return NamesIn(folder.PathOf("film")); }

std::vector<job::JobId> JobsWithResults(const DataFolder& folder) {
  return NamesIn(folder.PathOf("results"));
}

std::vector<UnitLogFile> UnitLogsOf(const DataFolder& folder, const job::JobId& job) {
  std::vector<UnitLogFile> logs;
  for (const FrameFile& file : FrameFilesIn(folder.FilmPath(job), DataFolder::kLogSuffix)) {
    std::error_code gone;
    const auto bytes = fs::file_size(file.path, gone);
    if (!gone)
      logs.push_back(
          {file.frame, absl::StrCat("film/", job.value(), "/", file.path.filename().string()), bytes});
  }
  return logs;
}

std::vector<UnitLogFile> UnitLogsOf(const DataFolder& folder, const job::JobId& job, int32_t frame) {
  std::vector<UnitLogFile> logs = UnitLogsOf(folder, job);
  std::erase_if(logs, [frame](const UnitLogFile& log) { return log.frame != frame; });
  return logs;
}

std::vector<int32_t> ResultsOf(const DataFolder& folder, const job::JobId& job) {
  std::vector<int32_t> frames;
  for (const FrameFile& file : FrameFilesIn(folder.ResultsPath(job), DataFolder::kResultSuffix))
    frames.push_back(file.frame);
  std::sort(frames.begin(), frames.end());
  return frames;
}

absl::Status RemoveLeftovers(const DataFolder& folder) {
  return RemovePartialFiles({folder.PathOf("results"), folder.PathOf("film")}, folder.files());
}

absl::Status RemoveLeftoversOf(const DataFolder& folder, const job::JobId& job) {
  return RemovePartialFiles({folder.ResultsPath(job), folder.FilmPath(job)}, folder.files());
}

}  // namespace lumifold::server
