#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/ledger/owner.h"

namespace lumifold::ledger {

/// A coordinator as it last described itself.
struct Member {
  Owner owner;
  /// HOST:PORT where others reach it.
  std::string address;
  /// Counts its calls of Renew. A coordinator whose count stands still is dead, or cannot reach the database.
  int64_t renewals = 0;
  int64_t active_jobs = 0;
  int64_t workers = 0;
  int64_t slots = 0;
  /// Leases that its jobs have or could have now.
  int64_t demand = 0;

  friend bool operator==(const Member&, const Member&) = default;
};

/// A job whose owner has left or was expelled, after the caller has become its owner.
struct AdoptedJob {
  job::JobId id;
  bool has_ended = false;
};

/// The coordinators that share a job store. A job belongs to the epoch in its row; a member may take the jobs
/// of epochs that are no members any more, and from then on the store refuses what the earlier owner writes.
///
/// Who is dead is decided by the members, each by its own clock (cluster::LeaseWatch); what counts is the
/// row. A member that was expelled in error has lost its jobs, but nothing that was acknowledged.
///
/// Errors of all calls: those of JobStore's storage. Every call can be repeated.
/// Threads: one at a time. It has a connection of its own, so that a renewal does not wait for commits.
class Roster {
 public:
  virtual ~Roster() = default;

  virtual absl::Status Join(const Member& self) = 0;
  /// Counts a renewal of the member with this epoch, records its figures, and returns all members by epoch.
  /// Errors: kAborted if it is no member: it was expelled, and its jobs may belong to others.
  virtual absl::StatusOr<std::vector<Member>> Renew(const Member& self) = 0;
  /// Its jobs may be adopted at once.
  virtual absl::Status Leave(Epoch epoch) = 0;
  /// Removes a member unless it has renewed since `renewals` was read. True if this call has removed it.
  virtual absl::StatusOr<bool> Expel(Epoch epoch, int64_t renewals) = 0;
  /// Makes a member the owner of all jobs, those that have ended too, that no member owns. Errors: kAborted
  /// as Renew.
  virtual absl::StatusOr<std::vector<AdoptedJob>> AdoptOrphans(const Owner& owner) = 0;
};

/// The roster of a PostgreSQL database that a JobStore has been opened in. Errors: those of
/// OpenPostgresJobStore.
absl::StatusOr<std::unique_ptr<Roster>> OpenPostgresRoster(const std::string& conninfo);

}  // namespace lumifold::ledger
