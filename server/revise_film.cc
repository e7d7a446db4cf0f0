#include "server/revise_film.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

#include "absl/strings/str_cat.h"
#include "server/film/unit_log.h"
#include "server/film/void_records.h"

namespace lumifold::server {
namespace {

using job::JobId;
using job_life::ReopenPlan;

absl::Status RemoveLog(const std::string& path, FileSystem* files) {
  int result = files->Remove(path);
  if (result >= 0) result = files->SyncFolder(FolderOf(path));
  if (result >= 0) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat(path, ": ", std::strerror(-result)));
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

}  // namespace

absl::StatusOr<std::vector<int32_t>> ReviseFilm(const DataFolder& folder, const JobId& job,
                                                const ReopenPlan& plan, FileSystem* files) {
  const auto path_of = [&](int32_t frame) { return folder.PathOf(DataFolder::UnitLogName(job, frame)); };
  const auto has_log = [&](int32_t frame) { return access(path_of(frame).c_str(), F_OK) == 0; };
  for (const int32_t frame : plan.frames_that_need_film()) {
    if (has_log(frame)) continue;
    return absl::FailedPreconditionError(absl::StrCat("job ", job.value(), ": the units of frame ", frame,
                                                      " are no longer kept; retry the whole frame"));
  }
  std::vector<int32_t> without_log;
  for (const int32_t frame : plan.frames()) {
    if (!has_log(frame)) {
      without_log.push_back(frame);
      continue;
    }
    absl::Status revised;
    switch (plan.KeptOf(frame)) {
      case ReopenPlan::Kept::kNone:
        revised = RemoveLog(path_of(frame), files);
        break;
      case ReopenPlan::Kept::kSome:
        revised = VoidUnkept(path_of(frame), job, plan, files);
        break;
      case ReopenPlan::Kept::kAll:
        break;
    }
    if (!revised.ok()) return revised;
  }
  return without_log;
}

}  // namespace lumifold::server
