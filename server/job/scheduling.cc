#include "server/job/scheduling.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "server/job/limits.h"

namespace lumifold::job {
namespace {

/// As of workers: rpc::kMaxTags, rpc::kMaxTagBytes and rpc::kMaxWorkerNameBytes, which this library does not
/// use.
constexpr int kMaxTags = 32;
constexpr size_t kMaxTagBytes = 64;
constexpr size_t kMaxClassBytes = 256;
constexpr size_t kMaxJobIdBytes = 64;

absl::Status CheckText(const std::string& field, const std::string& text, size_t least, size_t most) {
  if (text.size() >= least && text.size() <= most && text.find('\0') == std::string::npos)
    return absl::OkStatus();
  if (text.size() >= least && text.size() <= most)
    return absl::InvalidArgumentError(absl::StrCat(field, " has a NUL character"));
  return absl::InvalidArgumentError(
      absl::StrCat(field, " has ", text.size(), " bytes, not ", least, " to ", most));
}

absl::Status CheckCount(const std::string& field, int count, int most) {
  if (count <= most) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(field, " has ", count, " entries, allowed are ", most));
}

}  // namespace

absl::Status CheckPriority(int32_t priority) {
  if (priority >= kMinPriority && priority <= kMaxPriority) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("priority is ", priority, ", not ", kMinPriority, " to ", kMaxPriority));
}

absl::StatusOr<v1::Scheduling> NormaliseScheduling(v1::Scheduling scheduling) {
  if (scheduling.user().empty()) scheduling.set_user(kAnonymous);
  scheduling.clear_gaps();
  absl::Status status = CheckPriority(scheduling.priority());
  status.Update(CheckText("user", scheduling.user(), 1, kMaxNameBytes));
  status.Update(CheckText("name", scheduling.name(), 0, kMaxNameBytes));
  status.Update(CheckText("numeric_class", scheduling.numeric_class(), 0, kMaxClassBytes));
  status.Update(CheckCount("tags", scheduling.tags_size(), kMaxTags));
  for (const std::string& tag : scheduling.tags()) status.Update(CheckText("tags", tag, 1, kMaxTagBytes));
  status.Update(CheckCount("after", scheduling.after_size(), kMaxAfter));
  for (const std::string& id : scheduling.after()) status.Update(CheckText("after", id, 1, kMaxJobIdBytes));
  if (scheduling.max_leases() < 0)
    status.Update(absl::InvalidArgumentError(
        absl::StrCat("max_leases is ", scheduling.max_leases(), ", not 0 (no limit) or more")));
  if (!(scheduling.audit_share() >= 0 && scheduling.audit_share() <= 1))
    status.Update(absl::InvalidArgumentError(
        absl::StrCat("audit_share is ", scheduling.audit_share(), ", not 0 to 1")));
  if (!status.ok()) return status;
  return scheduling;
}

}  // namespace lumifold::job
