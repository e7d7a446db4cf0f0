#include "client/farm/follow_job.h"

#include <algorithm>
#include <optional>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "client/farm/standstill.h"
#include "client/reports/job_report.h"
#include "proto/retry/storage_away.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::client {
namespace {

/// Of the progress of a frame in the filter.
constexpr int64_t kFrameSteps = 1000;

}  // namespace

ProgressState ProgressOf(const v1::JobStatus& job) {
  ProgressState state;
  state.stage = std::string(StateName(job.state()));
  state.workers = job.workers();
  if (job.frames_total() > 1) state.note = FilteringText(job);
  const double filtered = job.frames_done() + job.frames_filtered();
  if (job.state() == v1::JOB_STATE_FILTERING && filtered > 0) {
    state.unit = ProgressUnit::kTime;
    state.done = static_cast<int64_t>(kFrameSteps * filtered);
    state.total = kFrameSteps * (job.frames_total() - job.frames_skipped());
  }
  if (job.state() != v1::JOB_STATE_RUNNING) return state;
  if (const double time = job.adaptive().time_seconds(); time > 0) {
    state.unit = ProgressUnit::kTime;
    const double rendered = std::min(job.times().render_seconds(), time);
    state.done = absl::ToInt64Milliseconds(absl::Seconds(rendered));
    state.total = absl::ToInt64Milliseconds(absl::Seconds(time));
  } else {
    state.done = job.samples_done();
    state.total = job.samples_total();
  }
  return state;
}

absl::StatusOr<v1::JobStatus> FollowJob(FarmClient& farm, const std::string& job_id, Progress& progress,
                                        Backoff backoff,
                                        absl::FunctionRef<void(const v1::JobStatus&)> on_status) {
  std::optional<v1::JobStatus> last;
  bool answered = false;  // by the stream that is open
  std::set<std::string> shown_warnings;
  Standstill standstill;
  const auto take = [&](const v1::JobStatus& job) {
    answered = true;
    last = job;
    standstill.Note(job, rpc::MonotonicNow());
    for (const std::string& warning : job.warnings()) {
      if (shown_warnings.insert(warning).second) progress.Message(absl::StrCat("warning: ", warning));
    }
    if (!HasEnded(job)) progress.Update(ProgressOf(job));
    on_status(job);
  };
  const auto tick = [&] {
    if (!last.has_value()) return;
    progress.Update(ProgressOf(*last));
    if (!standstill.IsTimeToAsk(rpc::MonotonicNow())) return;
    const absl::StatusOr<v1::ExplainJobResponse> answer = farm.ExplainJob(job_id);
    if (!answer.ok()) return;  // the stream says so
    for (const std::string& reason : standstill.NewReasons(*answer))
      progress.Message(absl::StrCat("job ", job_id, " waits: ", reason));
  };
  bool lost = false;
  while (true) {
    answered = false;
    absl::Status status = farm.WatchJob(job_id, take, tick);
    if (answered) backoff.Reset();  // an outage begins now, however long nothing has changed before
    if (last.has_value() && HasEnded(*last)) break;
    // A stream that ends before the job is a lost connection, whatever its status.
    const bool may_retry =
        status.ok() || (absl::IsUnavailable(status) && last.has_value()) || retry::IsStorageAway(status);
    if (!may_retry) return status;
    if (!lost && !status.ok()) progress.Message(absl::StrCat(status.message(), "; trying again"));
    lost = !status.ok();
    if (!backoff.Pause()) {
      return status.ok() ? absl::UnavailableError(absl::StrCat("lost the connection to job ", job_id))
                         : status;
    }
  }
  progress.Clear();
  return *last;
}

}  // namespace lumifold::client
