#include "client/farm/coordinators.h"

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "proto/identity/pinned_ca.h"
#include "proto/retry/schedule.h"
#include "proto/retry/storage_away.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/status_codec.h"
#include "proto/rpc/trace_context.h"

namespace lumifold::client {
namespace {

/// Short enough that an outage of seconds costs seconds, and that Ctrl-C is noticed soon.
constexpr retry::Pauses kPausesOfAnOutage = {.first = absl::Milliseconds(500), .longest = absl::Seconds(2)};

/// Of the question whether an address that a call did not reach is encrypted.
constexpr absl::Duration kProbeTimeout = absl::Seconds(1);

/// Without an interruption, kCancelled means that the other side closed the connection.
bool IsLost(const absl::Status& status) { return rpc::IsTransient(status) || absl::IsCancelled(status); }

/// Where there is another coordinator to go to, a silent one is left soon, also by streams without a deadline
/// of seconds.
Coordinators::Connect OverTheNetwork(const FarmClientOptions& options) {
  const rpc::KeepAlive keep_alive = options.coordinators.size() > 1 ? rpc::kQuickKeepAlive : rpc::KeepAlive{};
  return [security = options.security, keep_alive](const std::string& address) {
    return rpc::MakeChannel(address, security, keep_alive);
  };
}

}  // namespace

absl::Status CannotReach(const std::vector<std::string>& coordinators, absl::string_view message) {
  // gRPC lists all addresses it tried; the last error is enough for the user.
  constexpr absl::string_view kLead = "Failed to connect to remote host: ";
  const size_t at = message.rfind(kLead);
  const absl::string_view reason =
      at == absl::string_view::npos ? message : message.substr(at + kLead.size());
  const absl::string_view which =
      coordinators.size() > 1 ? "any of the coordinators " : "the coordinator at ";
  return absl::UnavailableError(
      absl::StrCat("cannot reach ", which, absl::StrJoin(coordinators, ", "), ": ", reason));
}

Coordinators::Coordinators(FarmClientOptions options, Connect connect)
    : options_(std::move(options)),
      connect_(std::move(connect)),
      channels_(size()),
      current_(
          std::min(static_cast<size_t>(options_.time.jitter() * static_cast<double>(size())), size() - 1)) {}

Coordinators::Coordinators(const FarmClientOptions& options)
    : Coordinators(options, OverTheNetwork(options)) {
  is_encrypted_ = [](const std::string& address) { return identity::IsEncrypted(address, kProbeTimeout); };
}

absl::Status Coordinators::Call(const CallPolicy& policy, Try call) {
  const bool answered = false;
  absl::Duration timeout = policy.retry.try_timeout;
  if (size() > 1) timeout = std::min(timeout, policy.first_timeout);
  const absl::Time begin = options_.time.now();
  retry::Schedule pauses(kPausesOfAnOutage, options_.time.jitter);
  while (true) {
    absl::Status status = rpc::Retry(policy.retry, options_.time, [&] {
      absl::Status tried = Stream(timeout, &answered, call);
      timeout = policy.retry.try_timeout;
      return tried;
    });
    if (!absl::IsUnavailable(status)) return status;
    const absl::Duration pause = pauses.Next();
    if (options_.time.now() + pause - begin > PatienceFor(status)) return status;
    options_.time.sleep(pause);
    if (interrupted()) return absl::CancelledError("interrupted");
  }
}

absl::Duration Coordinators::PatienceFor(const absl::Status& status) const {
  return retry::IsStorageAway(status) ? options_.patience : options_.patience_without_answer;
}

absl::Status Coordinators::CallOnce(absl::Duration timeout, Try call) {
  const bool answered = true;
  return Stream(timeout, &answered, call);
}

absl::Status Coordinators::Stream(absl::Duration timeout, const bool* answered, Try call) {
  for (size_t tried = 1;; ++tried) {
    grpc::ClientContext context;
    context.set_deadline(rpc::MonotonicDeadline(timeout));
    if (!options_.trace_parent.empty()) context.AddMetadata(rpc::kTraceParentKey, options_.trace_parent);
    absl::Status status = rpc::StatusFromGrpc(call(context, CurrentChannel()));
    if (status.ok()) return status;
    if (interrupted()) return absl::CancelledError("interrupted");
    if (!IsLost(status)) return status;
    const std::string& lost = options_.coordinators[current_];
    current_ = (current_ + 1) % size();
    if (retry::IsStorageAway(status) && (*answered || tried == size())) return status;
    if (*answered) return CannotReach({lost}, status.message());
    if (tried == size()) return NoneReached(lost, status);
  }
}

absl::Status Coordinators::NoneReached(const std::string& lost, const absl::Status& status) const {
  const std::optional<bool> is_encrypted =
      absl::IsUnavailable(status) && is_encrypted_ ? is_encrypted_(lost) : std::nullopt;
  if (is_encrypted.value_or(options_.security.uses_tls()) == options_.security.uses_tls())
    return CannotReach(options_.coordinators, status.message());
  return absl::UnavailableError(
      *is_encrypted ? absl::StrCat("the coordinator at ", lost,
                                   " is encrypted, and there is no profile for it: get access with "
                                   "'lumifold login ",
                                   lost, " CODE'")
                    : absl::StrCat("the coordinator at ", lost,
                                   " is not encrypted, but the profile that is used for it is: name another "
                                   "one with --profile, or remove it with 'lumifold logout'"));
}

const std::shared_ptr<grpc::Channel>& Coordinators::CurrentChannel() {
  std::shared_ptr<grpc::Channel>& channel = channels_[current_];
  if (channel == nullptr) channel = connect_(options_.coordinators[current_]);
  return channel;
}

}  // namespace lumifold::client
