#include "server/commit/revise_film.h"

#include <map>
#include <string>

#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "server/film/unit_log.h"
#include "server/film/void_records.h"
#include "server/storage/folder_contents.h"

namespace lumifold::server {
namespace {

using job::JobId;
using job::ReopenPlan;

absl::Status RemoveLog(const std::string& path, FileSystem* files) {
  int result = files->Remove(path);
  if (result >= 0) result = files->SyncFolder(FolderOf(path));
  return result < 0 ? StorageError(path, result) : absl::OkStatus();
}

absl::Status VoidUnkept(const std::string& path, const JobId& job, const ReopenPlan& plan,
                        FileSystem* files) {
  const absl::StatusOr<film::UnitLogReader> log = film::UnitLogReader::Open(path);
  if (!log.ok()) return log.status();
  std::vector<film::RecordPlace> places;
  const absl::StatusOr<uint64_t> scanned =
      log->Scan(0, [&](const film::StoredUnit& unit, const film::RecordPlace& place) {
        if (unit.unit.job != job || !plan.Keeps(unit.unit.key)) places.push_back(place);
      });
  if (!scanned.ok()) return scanned.status();
  return film::VoidRecords(path, places, files);
}

absl::Status ReviseLog(const std::string& path, const JobId& job, int32_t frame, const ReopenPlan& plan,
                       FileSystem* files) {
  switch (plan.KeptOf(frame)) {
    case ReopenPlan::Kept::kNone:
      return RemoveLog(path, files);
    case ReopenPlan::Kept::kSome:
      return VoidUnkept(path, job, plan, files);
    case ReopenPlan::Kept::kAll:
      break;
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::vector<int32_t>> ReviseFilm(const DataFolder& folder, const JobId& job,
                                                const ReopenPlan& plan, FileSystem* files) {
  std::map<int32_t, std::vector<std::string>> logs;
  for (const UnitLogFile& log : UnitLogsOf(folder, job)) logs[log.frame].push_back(folder.PathOf(log.name));
  for (const int32_t frame : plan.frames_that_need_film()) {
    if (logs.contains(frame)) continue;
    return absl::FailedPreconditionError(absl::StrCat("job ", job.value(), ": the units of frame ", frame,
                                                      " are no longer kept; retry the whole frame"));
  }
  std::vector<int32_t> without_log;
  for (const int32_t frame : plan.frames()) {
    if (!logs.contains(frame)) without_log.push_back(frame);
    for (const std::string& path : logs[frame]) {
      if (absl::Status revised = ReviseLog(path, job, frame, plan, files); !revised.ok()) return revised;
    }
  }
  return without_log;
}

}  // namespace lumifold::server
