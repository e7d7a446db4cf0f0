#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "lumifold/v1/farm.pb.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::page {

class FarmCalls;

/// What one session sees of the farm, as events of JSON. Each part has the number of the look at which it
/// last changed.
struct FarmLook {
  struct Part {
    std::string json;
    uint64_t changed = 0;
  };
  uint64_t number = 0;
  absl::Status status;  // of the calls
  Part server;
  Part workers;
  Part ids;  // of the jobs
  std::vector<std::string> order;
  std::map<std::string, Part> jobs;
};

/// The events that bring a viewer from the look that it has, 0 for none, to this one: text of an event
/// stream.
std::string EventsSince(uint64_t has, const FarmLook& look);

struct FarmViewOptions {
  /// Between two looks for one session.
  absl::Duration interval = absl::Milliseconds(500);
  /// Share of time that looking takes, over all sessions, so that viewers cost the farm little.
  double duty = 0.02;
};

/// Looks at the farm for all who watch with the same session, once for all of them and only while somebody
/// does.
/// Threads: safe.
class FarmView {
 public:
  /// `calls` must outlive it.
  FarmView(const FarmCalls* calls, FarmViewOptions options) : calls_(*calls), options_(options) {}

  /// The last look, or a new one where that is old enough. Blocks while one is made. Calls that fail are in
  /// its status; what they would have said is as before.
  std::shared_ptr<const FarmLook> Look(const v1::PageSession& session);

 private:
  struct Shared {
    absl::Mutex mutex;
    std::shared_ptr<const FarmLook> last ABSL_GUARDED_BY(mutex);
    absl::Time next ABSL_GUARDED_BY(mutex) = absl::InfinitePast();
    absl::Time used;  // guarded by that of the view
  };
  std::shared_ptr<Shared> SharedOf(const v1::PageSession& session, size_t* count);
  FarmLook LookAgain(const v1::PageSession& session, const FarmLook& last) const;

  const FarmCalls& calls_;
  const FarmViewOptions options_;
  absl::Mutex mutex_;
  std::map<std::string, std::shared_ptr<Shared>> shared_ ABSL_GUARDED_BY(mutex_);  // by what the session sees
};

}  // namespace lumifold::page
