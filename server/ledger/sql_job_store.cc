#include "server/ledger/sql_job_store.h"

#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "server/ledger/sql_commit.h"
#include "server/ledger/sql_deliveries.h"
#include "server/ledger/sql_jobs.h"
#include "server/ledger/sql_rows.h"
#include "server/ledger/sql_usage.h"

namespace lumifold::ledger {
namespace {

using job::JobId;

class SqlJobStore final : public JobStore, private DeliveryQueue {
 public:
  SqlJobStore(std::unique_ptr<SqlConnection> writer, std::unique_ptr<SqlConnection> reader)
      : writer_(std::move(writer)), reader_(std::move(reader)) {}

  absl::StatusOr<Epoch> NewEpoch(Epoch floor) override;
  absl::StatusOr<JobId> CreateJob(const NewJob& job) override;
  absl::StatusOr<std::optional<JobId>> FindRequest(const NewJob& job) override;
  absl::StatusOr<ClaimedJobs> ClaimUnfinishedJobs(const Owner& owner) override;
  absl::StatusOr<JobRecord> GetJob(const JobId& job) override;
  absl::StatusOr<JobPage> ListJobs(const JobFilter& filter) override;
  absl::StatusOr<std::vector<absl::Status>> CommitUnits(absl::Span<const JobCommit> commits) override;
  absl::Status RevokeUnits(const OwnedJob& job, absl::Span<const job::UnitKey> units) override;
  absl::Status ForEachUnit(const JobId& job, std::optional<int32_t> frame,
                           absl::FunctionRef<void(const UnitRecord&)> visit) override;
  absl::Status RecordFrame(const OwnedJob& job, int32_t frame, const v1::FrameReport& report) override;
  absl::Status RecordKeptFrame(const JobCommit& units, int32_t frame, const v1::FrameReport& report) override;
  absl::StatusOr<std::vector<int32_t>> FinishedFrames(const JobId& job) override;
  absl::StatusOr<std::vector<std::string>> DeliverersOf(const JobId& job) override;
  absl::Status EndJob(const OwnedJob& job, const JobEnd& end) override;
  DeliveryQueue& deliveries() override { return *this; }
  absl::Status ReopenFrames(const JobId& job, const Owner& owner, const Reopening& reopening) override;
  absl::Status SetScheduling(const OwnedJob& job, const v1::Scheduling& scheduling) override;
  absl::Status SetPlan(const OwnedJob& job, const v1::JobSpec& planned) override;
  absl::Status DeleteJob(const JobId& job) override;
  absl::StatusOr<int64_t> PurgeUnits(int64_t max_rows) override;
  absl::StatusOr<std::vector<JobUsage>> Usage(const UsageFilter& filter) override;
  absl::Status BlockWorker(const std::string& name, const std::string& reason) override;
  absl::Status ReadmitWorker(const std::string& name) override;
  absl::StatusOr<std::vector<BlockedWorker>> BlockedWorkers() override;

 private:
  absl::StatusOr<std::vector<Delivery>> Take(const std::string& origin, absl::Time now, absl::Time until,
                                             int max) override;
  absl::Status PutOff(int64_t number, absl::Time due, const std::string& error) override;
  absl::Status SetDelivered(int64_t number) override;
  absl::StatusOr<std::vector<DeliveryReport>> GiveUp(absl::Time created_before) override;
  absl::StatusOr<int64_t> CountWaiting() override;
  absl::StatusOr<std::optional<DeliveryReport>> LastOf(const JobId& job) override;

  /// Runs `body` in a transaction of the writer, with the locked row of a job.
  absl::Status ChangeJob(const JobId& job,
                         absl::FunctionRef<absl::Status(SqlConnection&, const LockedJob&)> body);
  /// The same for an active job that the caller must own.
  absl::Status ChangeOwnedJob(const OwnedJob& job,
                              absl::FunctionRef<absl::Status(SqlConnection&, int64_t)> body);

  absl::Mutex writer_mutex_;
  const std::unique_ptr<SqlConnection> writer_ ABSL_PT_GUARDED_BY(writer_mutex_);
  absl::Mutex reader_mutex_;
  const std::unique_ptr<SqlConnection> reader_ ABSL_PT_GUARDED_BY(reader_mutex_);
};

absl::Status SqlJobStore::ChangeJob(const JobId& job,
                                    absl::FunctionRef<absl::Status(SqlConnection&, const LockedJob&)> body) {
  absl::MutexLock lock(&writer_mutex_);
  SqlConnection& db = *writer_;
  return db.InTransaction([&]() -> absl::Status {
    const absl::StatusOr<std::vector<LockedJob>> rows = LockJobs(db, {job});
    if (!rows.ok()) return rows.status();
    if (!rows->front().status.ok()) return rows->front().status;
    return body(db, rows->front());
  });
}

absl::Status SqlJobStore::ChangeOwnedJob(const OwnedJob& job,
                                         absl::FunctionRef<absl::Status(SqlConnection&, int64_t)> body) {
  return ChangeJob(job.job, [&](SqlConnection& db, const LockedJob& row) {
    const absl::Status status = CheckOwned(job, row);
    return status.ok() ? body(db, row.number) : status;
  });
}

absl::StatusOr<Epoch> SqlJobStore::NewEpoch(Epoch floor) {
  absl::MutexLock lock(&writer_mutex_);
  const absl::StatusOr<std::optional<int64_t>> epoch = writer_->QueryInt(
      "UPDATE epochs SET last = CASE WHEN last > $1 THEN last ELSE $1 END + 1 RETURNING last",
      {floor.value()});
  if (!epoch.ok()) return epoch.status();
  if (!epoch->has_value()) return absl::InternalError("ledger: its sequence of epochs is gone");
  return Epoch(**epoch);
}

absl::StatusOr<JobId> SqlJobStore::CreateJob(const NewJob& job) {
  absl::MutexLock lock(&writer_mutex_);
  JobId id;
  const absl::Status status =
      writer_->InTransaction([&]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return InsertJob(*writer_, job, &id); });
  if (!status.ok()) return status;
  return id;
}

absl::StatusOr<std::optional<JobId>> SqlJobStore::FindRequest(const NewJob& job) {
  absl::MutexLock lock(&reader_mutex_);
  return QueryRequest(*reader_, job);
}

absl::StatusOr<ClaimedJobs> SqlJobStore::ClaimUnfinishedJobs(const Owner& owner) {
  absl::MutexLock lock(&writer_mutex_);
  ClaimedJobs claimed;
  const absl::Status status = writer_->InTransaction(
      [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return ClaimJobs(*writer_, owner, &claimed); });
  if (!status.ok()) return status;
  return claimed;
}

absl::StatusOr<JobRecord> SqlJobStore::GetJob(const JobId& job) {
  absl::MutexLock lock(&reader_mutex_);
  absl::StatusOr<std::vector<JobRow>> rows =
      QueryJobs(*reader_, /*with_files=*/true, "WHERE id = $1", {job.value()});
  if (!rows.ok()) return rows.status();
  if (rows->empty()) return NoJob(job);
  if (!rows->front().damage.ok()) return rows->front().damage;
  if (absl::Status status = AddWarnings(*reader_, &*rows); !status.ok()) return status;
  return std::move(rows->front().record);
}

absl::StatusOr<JobPage> SqlJobStore::ListJobs(const JobFilter& filter) {
  absl::MutexLock lock(&reader_mutex_);
  return QueryPage(*reader_, filter);
}

absl::StatusOr<std::vector<absl::Status>> SqlJobStore::CommitUnits(absl::Span<const JobCommit> commits) {
  absl::MutexLock lock(&writer_mutex_);
  absl::StatusOr<std::vector<absl::Status>> outcomes;
  const absl::Status status = writer_->InTransaction([&]() ABSL_NO_THREAD_SAFETY_ANALYSIS {
    outcomes = CommitJobs(*writer_, commits);
    return outcomes.status();
  });
  if (!status.ok()) return status;
  return outcomes;
}

absl::Status SqlJobStore::RevokeUnits(const OwnedJob& job, absl::Span<const job::UnitKey> units) {
  return ChangeOwnedJob(
      job, [units](SqlConnection& db, int64_t number) { return DeleteUnits(db, number, units); });
}

absl::Status SqlJobStore::ForEachUnit(const JobId& job, std::optional<int32_t> frame,
                                      absl::FunctionRef<void(const UnitRecord&)> visit) {
  absl::MutexLock lock(&reader_mutex_);
  return VisitUnits(*reader_, job, frame, visit);
}

absl::Status SqlJobStore::RecordFrame(const OwnedJob& job, int32_t frame, const v1::FrameReport& report) {
  return ChangeOwnedJob(
      job, [&](SqlConnection& db, int64_t number) { return FinishFilm(db, number, frame, report); });
}

absl::Status SqlJobStore::RecordKeptFrame(const JobCommit& units, int32_t frame,
                                          const v1::FrameReport& report) {
  return ChangeOwnedJob(units.job, [&](SqlConnection& db, int64_t number) -> absl::Status {
    bool is_finished = false;
    int64_t committed = 0;
    absl::Status status = db.Query("SELECT finished, units FROM films WHERE job = $1 AND frame = $2",
                                   {number, frame}, [&](SqlRow& row) {
                                     is_finished = row.Int() != 0;
                                     committed = row.Int();
                                   });
    if (!status.ok() || is_finished) return status;
    if (committed > 0)
      return absl::AlreadyExistsError(absl::StrCat("frame ", frame, " has units that are committed"));
    status = FinishFilm(db, number, frame, report);  // first: its units have no rows to be deleted
    return status.ok() ? CountKept(db, number, units) : status;
  });
}

absl::StatusOr<std::vector<int32_t>> SqlJobStore::FinishedFrames(const JobId& job) {
  absl::MutexLock lock(&reader_mutex_);
  return QueryFinishedFrames(*reader_, job);
}

absl::StatusOr<std::vector<std::string>> SqlJobStore::DeliverersOf(const JobId& job) {
  absl::MutexLock lock(&reader_mutex_);
  return QueryDeliverers(*reader_, job);
}

absl::Status SqlJobStore::EndJob(const OwnedJob& job, const JobEnd& end) {
  return ChangeJob(job.job, [&](SqlConnection& db, const LockedJob& row) -> absl::Status {
    if (row.epoch != job.epoch) return OtherOwner(job.job, row.epoch, job.epoch);
    if (row.has_ended) return absl::OkStatus();
    if (absl::Status status = DiscardFilms(db, row.number, "finished = 0", {}); !status.ok()) return status;
    absl::Status status = db.Run("UPDATE jobs SET state = $1, error = $2 WHERE number = $3",
                                 {int64_t{end.state}, end.error, row.number});
    return status.ok() && end.delivery.has_value() ? InsertDelivery(db, row.number, *end.delivery) : status;
  });
}

absl::Status SqlJobStore::ReopenFrames(const JobId& job, const Owner& owner, const Reopening& reopening) {
  return ChangeJob(job, [&](SqlConnection& db, const LockedJob& row) {
    // A job that has ended belongs to nobody; but a coordinator of an earlier epoch would repeat its
    // attempts.
    const bool is_owned = row.has_ended ? row.epoch <= owner.epoch : row.epoch == owner.epoch;
    return is_owned ? ReopenJob(db, row.number, owner, reopening) : OtherOwner(job, row.epoch, owner.epoch);
  });
}

absl::Status SqlJobStore::SetScheduling(const OwnedJob& job, const v1::Scheduling& scheduling) {
  return ChangeOwnedJob(job, [&](SqlConnection& db, int64_t number) {
    return db.Run("UPDATE jobs SET scheduling = $1, user_name = $2 WHERE number = $3",
                  {SqlBytes{scheduling.SerializeAsString()}, scheduling.user(), number});
  });
}

absl::Status SqlJobStore::SetPlan(const OwnedJob& job, const v1::JobSpec& planned) {
  return ChangeOwnedJob(job, [&](SqlConnection& db, int64_t number) {
    return db.Run("UPDATE jobs SET spec = $1 WHERE number = $2",
                  {SqlBytes{BytesOfSpec(planned).spec}, number});  // its files do not change
  });
}

absl::Status SqlJobStore::DeleteJob(const JobId& job) {
  return ChangeJob(job, [&job](SqlConnection& db, const LockedJob& row) {
    if (!row.has_ended)
      return absl::FailedPreconditionError(absl::StrCat("job ", job.value(), " has not ended"));
    return RemoveJob(db, row.number);
  });
}

absl::StatusOr<int64_t> SqlJobStore::PurgeUnits(int64_t max_rows) {
  absl::MutexLock lock(&writer_mutex_);
  absl::StatusOr<int64_t> left;
  const absl::Status status = writer_->InTransaction([&]() ABSL_NO_THREAD_SAFETY_ANALYSIS {
    left = DeleteGarbage(*writer_, max_rows);
    return left.status();
  });
  if (!status.ok()) return status;
  return left;
}

absl::StatusOr<std::vector<JobUsage>> SqlJobStore::Usage(const UsageFilter& filter) {
  absl::MutexLock lock(&reader_mutex_);
  return QueryUsage(*reader_, filter);
}

absl::Status SqlJobStore::BlockWorker(const std::string& name, const std::string& reason) {
  absl::MutexLock lock(&writer_mutex_);
  return writer_->Run(
      "INSERT INTO blocked_workers(name, reason) VALUES($1, $2) ON CONFLICT(name) DO UPDATE SET reason = "
      "excluded.reason",
      {name, reason});
}

absl::Status SqlJobStore::ReadmitWorker(const std::string& name) {
  absl::MutexLock lock(&writer_mutex_);
  bool was_blocked = false;
  absl::Status status = writer_->Query("DELETE FROM blocked_workers WHERE name = $1 RETURNING name", {name},
                                       [&was_blocked](SqlRow&) { was_blocked = true; });
  if (!status.ok() || was_blocked) return status;
  return absl::NotFoundError(absl::StrCat("worker '", name, "' is not blocked"));
}

absl::StatusOr<std::vector<BlockedWorker>> SqlJobStore::BlockedWorkers() {
  absl::MutexLock lock(&reader_mutex_);
  return QueryBlockedWorkers(*reader_);
}

absl::StatusOr<std::vector<Delivery>> SqlJobStore::Take(const std::string& origin, absl::Time now,
                                                        absl::Time until, int max) {
  absl::MutexLock lock(&writer_mutex_);
  return TakeDeliveries(*writer_, origin, now, until, max);
}

absl::Status SqlJobStore::PutOff(int64_t number, absl::Time due, const std::string& error) {
  absl::MutexLock lock(&writer_mutex_);
  return PutDeliveryOff(*writer_, number, due, error);
}

absl::Status SqlJobStore::SetDelivered(int64_t number) {
  absl::MutexLock lock(&writer_mutex_);
  return RecordDelivered(*writer_, number);
}

absl::StatusOr<std::vector<DeliveryReport>> SqlJobStore::GiveUp(absl::Time created_before) {
  absl::MutexLock lock(&writer_mutex_);
  return GiveUpDeliveries(*writer_, created_before);
}

absl::StatusOr<int64_t> SqlJobStore::CountWaiting() {
  absl::MutexLock lock(&reader_mutex_);
  return CountWaitingDeliveries(*reader_);
}

absl::StatusOr<std::optional<DeliveryReport>> SqlJobStore::LastOf(const JobId& job) {
  absl::MutexLock lock(&reader_mutex_);
  return QueryLastDelivery(*reader_, job);
}

}  // namespace

std::unique_ptr<JobStore> MakeSqlJobStore(std::unique_ptr<SqlConnection> writer,
                                          std::unique_ptr<SqlConnection> reader) {
  return std::make_unique<SqlJobStore>(std::move(writer), std::move(reader));
}

}  // namespace lumifold::ledger
