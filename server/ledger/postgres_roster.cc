#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "lumifold/v1/job.pb.h"
#include "server/ledger/postgres_connection.h"
#include "server/ledger/roster.h"

namespace lumifold::ledger {
namespace {

absl::Status Expelled(Epoch epoch) {
  return absl::AbortedError(absl::StrCat("the coordinator of epoch ", epoch.value(),
                                         " was taken for dead: its jobs belong to others"));
}

Member ReadMember(SqlRow& row) {
  Member member;
  member.owner.epoch = Epoch(row.Int());
  member.owner.name = row.Text();
  member.address = row.Text();
  member.renewals = row.Int();
  member.active_jobs = row.Int();
  member.workers = row.Int();
  member.slots = row.Int();
  member.demand = row.Int();
  return member;
}

class PostgresRoster final : public Roster {
 public:
  explicit PostgresRoster(std::unique_ptr<PostgresConnection> db) : db_(std::move(db)) {}

  absl::Status Join(const Member& self) override {
    return db_->Run(
        "INSERT INTO coordinators(epoch, name, address) VALUES($1, $2, $3) ON CONFLICT(epoch) DO NOTHING",
        {self.owner.epoch.value(), self.owner.name, self.address});
  }

  absl::StatusOr<std::vector<Member>> Renew(const Member& self) override {
    std::vector<Member> members;
    const absl::Status status = db_->InTransaction([&]() -> absl::Status {
      const absl::StatusOr<std::optional<int64_t>> renewed = db_->QueryInt(
          "UPDATE coordinators SET renewals = renewals + 1, active_jobs = $2, workers = $3, slots = $4, "
          "demand = $5 WHERE epoch = $1 RETURNING renewals",
          {self.owner.epoch.value(), self.active_jobs, self.workers, self.slots, self.demand});
      if (!renewed.ok()) return renewed.status();
      if (!renewed->has_value()) return Expelled(self.owner.epoch);
      return db_->Query(
          "SELECT epoch, name, address, renewals, active_jobs, workers, slots, demand FROM coordinators "
          "ORDER BY epoch",
          {}, [&members](SqlRow& row) { members.push_back(ReadMember(row)); });
    });
    if (!status.ok()) return status;
    return members;
  }

  absl::Status Leave(Epoch epoch) override {
    return db_->Run("DELETE FROM coordinators WHERE epoch = $1", {epoch.value()});
  }

  absl::StatusOr<bool> Expel(Epoch epoch, int64_t renewals) override {
    const absl::StatusOr<std::optional<int64_t>> removed =
        db_->QueryInt("DELETE FROM coordinators WHERE epoch = $1 AND renewals = $2 RETURNING epoch",
                      {epoch.value(), renewals});
    if (!removed.ok()) return removed.status();
    return removed->has_value();
  }

  absl::StatusOr<std::vector<AdoptedJob>> AdoptOrphans(const Owner& owner) override {
    std::vector<AdoptedJob> adopted;
    const absl::Status status = db_->InTransaction([&]() -> absl::Status {
      // While this row is locked nobody expels the caller.
      const absl::StatusOr<std::optional<int64_t>> member =
          db_->QueryInt("SELECT epoch FROM coordinators WHERE epoch = $1 FOR UPDATE", {owner.epoch.value()});
      if (!member.ok()) return member.status();
      if (!member->has_value()) return Expelled(owner.epoch);
      // Rows are locked in the order of the ids, as in every transaction that writes to jobs.
      std::vector<int64_t> numbers;
      absl::Status found = db_->Query(
          "SELECT number, id, state FROM jobs WHERE NOT EXISTS (SELECT 1 FROM coordinators WHERE "
          "coordinators.epoch = jobs.epoch) ORDER BY id FOR UPDATE OF jobs",
          {}, [&](SqlRow& row) {
            numbers.push_back(row.Int());
            AdoptedJob& job = adopted.emplace_back();
            job.id = job::JobId(row.Text());
            job.has_ended = row.Int() != v1::JOB_STATE_SUBMITTED;
          });
      if (!found.ok()) return found;
      std::vector<SqlParams> batch;
      batch.reserve(numbers.size());
      for (const int64_t number : numbers) batch.push_back({owner.name, owner.epoch.value(), number});
      return db_->RunBatch("UPDATE jobs SET owner = $1, epoch = $2 WHERE number = $3", batch);
    });
    if (!status.ok()) return status;
    return adopted;
  }

 private:
  const std::unique_ptr<PostgresConnection> db_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<Roster>> OpenPostgresRoster(const std::string& conninfo) {
  absl::StatusOr<std::unique_ptr<PostgresConnection>> db = PostgresConnection::Open(conninfo);
  if (!db.ok()) return db.status();
  return std::make_unique<PostgresRoster>(*std::move(db));
}

}  // namespace lumifold::ledger
