#pragma once

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/synchronization/mutex.h"
#include "server/coordinator/farm.h"

namespace lumifold::server {

/// The farm behind its lock, the only one that several threads of a coordinator share. The lock is never held
/// during a call of the ledger or of a file, so that slow storage does not delay leases.
/// Threads: safe.
class FarmState {
 public:
  /// Both must outlive it.
  FarmState(const Resources* resources, FarmEffects* effects) : farm_(resources, effects) {}

  /// Holds the lock for a look at the farm.
  class View {
   public:
    explicit View(FarmState* state) ABSL_NO_THREAD_SAFETY_ANALYSIS : state_(state) { state->mutex_.Lock(); }
    ~View() ABSL_NO_THREAD_SAFETY_ANALYSIS { state_->mutex_.Unlock(); }
    View(const View&) = delete;
    View& operator=(const View&) = delete;
    const Farm* operator->() const ABSL_NO_THREAD_SAFETY_ANALYSIS { return &state_->farm_; }
    const Farm& operator*() const ABSL_NO_THREAD_SAFETY_ANALYSIS { return state_->farm_; }

   private:
    FarmState* const state_;
  };

  /// Holds the lock for a change of the farm, and completes it at its end (Farm::Complete).
  class Change {
   public:
    explicit Change(FarmState* state) ABSL_NO_THREAD_SAFETY_ANALYSIS : state_(state) { state->mutex_.Lock(); }
    ~Change() ABSL_NO_THREAD_SAFETY_ANALYSIS {
      state_->farm_.Complete();
      state_->mutex_.Unlock();
    }
    Change(const Change&) = delete;
    Change& operator=(const Change&) = delete;
    Farm* operator->() const ABSL_NO_THREAD_SAFETY_ANALYSIS { return &state_->farm_; }
    Farm& operator*() const ABSL_NO_THREAD_SAFETY_ANALYSIS { return state_->farm_; }

   private:
    FarmState* const state_;
  };

  /// Waits until the condition holds. False: the coordinator is stopping.
  bool Await(absl::FunctionRef<bool(const Farm&)> condition) ABSL_NO_THREAD_SAFETY_ANALYSIS {
    absl::MutexLock lock(&mutex_);
    const auto is_over = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS {
      return farm_.is_stopping() || condition(farm_);
    };
    mutex_.Await(absl::Condition(&is_over));
    return !farm_.is_stopping();
  }

 private:
  absl::Mutex mutex_;
  Farm farm_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::server
