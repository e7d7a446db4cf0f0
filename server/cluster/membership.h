#pragma once

#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "proto/threads/event.h"
#include "server/cluster/balance.h"
#include "server/cluster/lease_watch.h"
#include "server/ledger/roster.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::cluster {

/// What membership asks of a coordinator, all on threads of Membership, which must not be held up: its lease
/// would expire.
class MemberHost {
 public:
  virtual ~MemberHost() = default;

  /// Sets the metrics of `member`.
  virtual void SetMetrics(ledger::Member* member) = 0;
  /// These jobs are this coordinator's from now on.
  virtual void Adopt(const std::vector<ledger::AdoptedJob>& jobs) = 0;
  virtual void MoveWorkers(const WorkerMove& move) = 0;
  /// The database has not answered for longer than the lease, so that what workers deliver here cannot be
  /// committed: all are to go at once to the coordinator at `address`, or to any other that they know if it
  /// is empty.
  virtual void SendWorkersAway(const std::string& address) = 0;
  /// This coordinator was expelled: all its jobs belong to others. It is called once, and last.
  virtual void OnExpelled() = 0;
  /// For what depends on others and has no signal: jobs that others end, files that others store.
  virtual void LookAtOthers() = 0;
};

struct MembershipOptions {
  ledger::Owner owner;
  /// HOST:PORT where others reach this coordinator.
  std::string address;
  /// Time without a renewal after which a member's jobs go to others. It is renewed six times in it.
  absl::Duration lease = absl::Seconds(3);
  std::shared_ptr<spdlog::logger> log;
};

/// Keeps a coordinator a member of its farm: renews its lease, expels members whose leases have expired,
/// adopts the jobs of those that are gone, and sends workers where they are needed.
/// Threads: safe; it has two of its own.
class Membership {
 public:
  /// Arguments must outlive it.
  Membership(MembershipOptions options, ledger::Roster* roster, MemberHost* host);
  ~Membership() { Stop(); }

  /// Joins, adopts what nobody owns, and starts the threads. Errors: those of the roster.
  absl::Status Start();
  /// Ends the threads. The coordinator stays a member.
  void Stop();
  /// Leaves: others adopt the jobs at once. Call it after Stop, when nothing more is written.
  void Leave();

  /// As last read, by epoch; this coordinator among them.
  std::vector<ledger::Member> members() const;
  const ledger::Owner& self() const { return options_.owner; }

 private:
  void Run();
  /// Sends workers away while the database cannot be reached. The other thread may wait for it then.
  void WatchDatabase();
  absl::Status Tick();
  /// Those that had this address on this machine before cannot be running: their jobs need not wait for their
  /// leases.
  absl::Status ExpelPredecessors();
  absl::Status AdoptOrphans();
  void Balance(absl::Time now);

  const MembershipOptions options_;
  ledger::Roster* const roster_;
  MemberHost* const host_;

  // Of the thread of Run().
  LeaseWatch watch_;
  absl::Time next_adoption_ = absl::InfinitePast();
  absl::Time next_move_;
  std::vector<ledger::Epoch> known_;

  mutable absl::Mutex mutex_;
  absl::Time renewed_ ABSL_GUARDED_BY(mutex_);
  std::vector<ledger::Member> members_ ABSL_GUARDED_BY(mutex_);
  threads::Event stop_;
  std::thread thread_;
  std::thread database_watch_;
};

}  // namespace lumifold::cluster
