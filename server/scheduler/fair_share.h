#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include "absl/time/time.h"

namespace lumifold::scheduler {

/// Fair sharing of slots by weight, at two levels: users, then the priorities of a user's jobs. Jobs of one
/// user and priority are served in the order of their turns: whoever divides its slots between its own jobs
/// gets the first of them later and none earlier.
///
/// The weight of a priority is 2^(priority / 10), a user's is that of its highest job. The next lease goes to
/// the ready user with the least key, there to the ready priority with the least key, and there to the ready
/// job with the least turn; key = (held * kSlotTime + usage) / weight, where `held` counts leases and `usage`
/// is the slot time of leases that have ended.
///
/// The first term divides the slots of the moment. The second one keeps weights where slots are fewer than
/// users, and is bounded: usage per weight stays close to the virtual time, that of the user (or priority)
/// that was first last, so that nobody pays later for slots that were idle, and nobody saves up time by being
/// idle.
///
/// Time: O(log n) for each call unless it says otherwise, n counts users, priorities and jobs.
///
/// Threads: one at a time.
class FairShare {
 public:
  /// Usage that counts as much as one held slot.
  static constexpr double kSlotSeconds = 60;

  /// A job's place among those of its user and priority: its turn (see JobOptions), then its number.
  using Turn = std::pair<int64_t, int64_t>;

  /// Ready jobs that the same workers may render. It outlives the jobs' membership.
  class Queue {
   public:
    bool IsEmpty() const { return waiting_.empty(); }

   private:
    friend class FairShare;
    using Band = std::pair<int64_t, int>;            // a user's number, and a priority
    std::set<std::pair<double, int64_t>> users_;     // by key
    std::set<std::pair<absl::Time, Band>> waiting_;  // bands, by the time since when they wait
  };

  /// A ready job and its place in the order.
  struct Candidate {
    int64_t job = 0;
    std::pair<double, int64_t> user_key;
    std::pair<double, int> band_key;
    Turn turn;

    bool operator<(const Candidate& other) const {
      return std::tie(user_key, band_key, turn) < std::tie(other.user_key, other.band_key, other.turn);
    }
  };

  /// By how much a user or a priority of one may be ahead of its share: by a number of slots, or by a part of
  /// those it holds.
  struct Tolerance {
    double slots = 1;
    double user_part = 0.05;
    double band_part = 0.25;
  };

  /// Adds a job, which is not ready. `job` is new.
  void AddJob(int64_t job, const std::string& user, int priority, int64_t turn);
  /// The job is known, here and below. It leaves its queue.
  void RemoveJob(int64_t job);
  void SetPriority(int64_t job, int priority);
  void SetTurn(int64_t job, int64_t turn);
  /// Enters the job into a queue, null for none, and removes it from the one it was in.
  void SetQueue(int64_t job, Queue* queue, absl::Time now);
  /// The first job is to get the next lease, not one that is preferred to it: its place is the virtual time.
  void Choose(const Candidate& first);
  /// The job has got a lease; the jobs of its user, priority and queue wait for the next one from now on.
  void Granted(int64_t job, absl::Time now);
  /// A lease of the job has ended after `slot_time`.
  void Ended(int64_t job, absl::Duration slot_time);

  /// The first job of the queue that is not in `passed`; O((1 + passed) log n).
  std::optional<Candidate> First(Queue& queue, const std::set<int64_t>& passed);
  /// The first job of the user and priority that have waited longest, and since when; nullopt for an empty
  /// queue.
  std::optional<std::pair<absl::Time, int64_t>> LongestWaiting(Queue& queue) const;
  /// Whether it is the turn of the job, which is ready, and its user and priority are within the tolerance of
  /// their shares, if `first` would be next.
  bool IsNear(int64_t job, const Candidate& first, const Tolerance& tolerance) const;
  /// The queue of the job; null for none.
  const Queue* QueueOf(int64_t job) const { return jobs_.at(job).queue; }
  /// The turns before the job's, of ready jobs of the same user and priority. O(jobs).
  std::set<Turn> TurnsBefore(int64_t job) const;
  /// The least turn of the jobs of the same user and priority, ready or not. O(jobs).
  int64_t FirstTurn(int64_t job) const;
  const std::string& UserOf(int64_t job) const { return users_.at(jobs_.at(job).user).name; }
  /// The share of the farm that the job's user has among the users that are ready, itself included. O(users).
  double ShareOfUser(int64_t job) const;

 private:
  struct Account {
    double weight = 1;
    int64_t held = 0;
    double usage = 0;  // slot seconds
    double key = 0;

    double VirtualTime() const { return usage / weight; }
    double Key() const { return (static_cast<double>(held) * kSlotSeconds + usage) / weight; }
  };
  /// The jobs of a user that have one priority.
  struct Band {
    struct Ready {
      std::set<Turn> jobs;  // never empty
      absl::Time waits_since;
    };
    int jobs = 0;  // ready or not; never 0
    Account account;
    std::map<Queue*, Ready> ready;
  };
  struct User {
    std::string name;
    Account account;
    double virtual_time = 0;  // of its bands
    std::map<int, Band> bands;
    std::map<Queue*, std::set<std::pair<double, int>>> ready;  // bands by key; never empty
  };
  struct Job {
    int64_t user = 0;
    int priority = 0;
    int64_t turn = 0;
    int64_t held = 0;
    Queue* queue = nullptr;
  };

  static double WeightOf(int priority);
  /// An ended lease is charged, but no account gets further ahead of the virtual time than it could get with
  /// this one.
  static void Charge(double seconds, double virtual_time, Account* account);
  /// False for an account that is not behind the virtual time by more than a slot.
  static bool Lift(double virtual_time, double slack, Account* account);
  /// Usage per weight stays as it is.
  static void SetWeight(double weight, Account* account);
  User& OwnerOf(const Job& job) { return users_.at(job.user); }
  static Band& BandOf(const Job& job, User& user) { return user.bands.at(job.priority); }
  /// Enters a user or band by its new key after its account has changed.
  static void Reorder(int64_t number, User& user);
  static void Reorder(int priority, Band& band, User& user);
  /// The job, which is in no queue, joins the band of its priority, or leaves it.
  void JoinBand(const Job& job);
  void LeaveBand(const Job& job);
  void UpdateWeight(int64_t number);
  /// `was_ready`: it has only left another queue, and keeps what it is owed.
  void Enter(int64_t number, const Job& job, bool was_ready, absl::Time waits_since);
  /// Returns since when the band has waited.
  absl::Time Leave(int64_t number, Job& job);

  double virtual_time_ = 0;  // of the users
  int64_t next_user_ = 0;
  std::map<std::string, int64_t> user_numbers_;
  std::map<int64_t, User> users_;  // that have jobs
  std::map<int64_t, Job> jobs_;
};

}  // namespace lumifold::scheduler
