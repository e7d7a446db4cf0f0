#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/retry.h"

namespace grpc {
class Channel;
class ClientContext;
class Status;
}  // namespace grpc

namespace lumifold::client {

/// kUnavailable "cannot reach the coordinator at ADDRESS: ...", or of several "cannot reach any of the
/// coordinators A, B: ...", with what a user needs of gRPC's `message`.
absl::Status CannotReach(const std::vector<std::string>& coordinators, absl::string_view message);

struct FarmClientOptions {
  /// The coordinators of one farm, 1 or more, each HOST:PORT; also for errors.
  std::vector<std::string> coordinators;
  rpc::Security security = {};
  /// Its jitter also chooses the coordinator that is tried first: 0 means the first of the list.
  rpc::RetryEnvironment time;
  /// True after the user interrupted the program.
  std::function<bool()> interrupted;
  /// How long idempotent calls are tried again where a coordinator says that the storage of the farm is away.
  absl::Duration patience = absl::Seconds(30);
  /// The same where none can be reached; then the tries of the call's policy come first.
  absl::Duration patience_without_answer = absl::ZeroDuration();
  /// Sent with every call, see rpc::ContinueTrace; empty: none.
  std::string trace_parent = {};
};

/// Limits of a call with one request and one response.
struct CallPolicy {
  /// A try goes to each coordinator in turn, until one answers; its deadline is for each of them.
  rpc::RetryPolicy retry;
  /// Deadline of the first try where there are several coordinators, if it is shorter.
  absl::Duration first_timeout = absl::InfiniteDuration();
};

/// Of short calls: few tries with short pauses, so that the user soon sees the error of a wrong address. With
/// a silent coordinator in the list they take 3 s longer; half of that would leave a busy one too often.
inline constexpr CallPolicy kShortCall = {
    .retry = {.try_timeout = absl::Seconds(10), .total_timeout = absl::Seconds(20), .max_tries = 3},
    .first_timeout = absl::Seconds(3)};

/// The coordinators of one farm, any of which answers any client. Calls go to the one that answered last, the
/// first call to one at random, so that clients and their jobs spread. A coordinator that cannot be reached,
/// is stopping, or does not answer within the deadline is left for the next of the list at once.
/// Errors of calls: kUnavailable of CannotReach, or as retry::IsStorageAway; kCancelled when the user
/// interrupted; otherwise the coordinator's.
/// Threads: one call at a time.
class Coordinators {
 public:
  using Connect = std::function<std::shared_ptr<grpc::Channel>(const std::string& address)>;
  /// One call. It may be made again with a new context.
  using Try =
      absl::FunctionRef<grpc::Status(grpc::ClientContext&, const std::shared_ptr<grpc::Channel>& channel)>;

  /// `connect` is called once for each coordinator, when it is first needed.
  Coordinators(FarmClientOptions options, Connect connect);
  /// Channels over the network.
  explicit Coordinators(const FarmClientOptions& options);

  size_t size() const { return options_.coordinators.size(); }
  bool interrupted() const { return options_.interrupted(); }

  /// An idempotent call. Pauses begin once all coordinators were tried. The last error, or that of the
  /// policy's limits, is returned once the patience of the options is at its end.
  absl::Status Call(const CallPolicy& policy, Try call);

  /// A call that must not be repeated once it may have taken effect: one try at one coordinator. Where there
  /// are several, another call should come before it, so that it goes to one that answers.
  absl::Status CallOnce(absl::Duration timeout, Try call);

  /// A stream, opened at each coordinator at most once, without pauses, until `call` has set *answered. If it
  /// breaks later, the caller decides when to open it again; that goes to the next coordinator.
  absl::Status Stream(absl::Duration timeout, const bool* answered, Try call);

 private:
  const std::shared_ptr<grpc::Channel>& CurrentChannel();
  /// The error of a call that reached none, the last of them `lost`.
  absl::Status NoneReached(const std::string& lost, const absl::Status& status) const;
  absl::Duration PatienceFor(const absl::Status& status) const;

  const FarmClientOptions options_;
  const Connect connect_;
  std::function<std::optional<bool>(const std::string& address)> is_encrypted_;  // empty: not asked
  std::vector<std::shared_ptr<grpc::Channel>> channels_;                         // null: not used yet
  size_t current_;
};

}  // namespace lumifold::client
