#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace lumifold::webhooks {

/// What one request may cost.
struct RequestLimits {
  absl::Duration connect_time = absl::Seconds(5);
  /// From its start to the end of its answer.
  absl::Duration time = absl::Seconds(10);
  /// Of the answer's body, which nobody reads: what is longer is cut off.
  size_t answer_bytes = 64 << 10;
};

struct PostRequest {
  /// Of the caller's choice; each once at a time.
  int64_t number = 0;
  std::string url;
  std::string body;
  /// "NAME: VALUE".
  std::vector<std::string> headers;
};

struct PostOutcome {
  int64_t number = 0;
  /// OK: the receiver has answered with 2xx. Otherwise one line that does not have the URL.
  absl::Status status;
};

/// Sends JSON by POST over HTTP/1.1, several requests at a time. It follows no redirection, uses no proxy,
/// keeps no cookies and sends no credentials. Certificates are verified.
/// Threads: one, but for Wake.
class Poster {
 public:
  /// `ca_path`: PEM file of the authorities to trust; empty: the system's.
  /// Errors: kUnavailable where the library cannot start or the file cannot be read.
  static absl::StatusOr<std::unique_ptr<Poster>> Open(const std::string& ca_path,
                                                      const RequestLimits& limits);
  ~Poster();
  Poster(const Poster&) = delete;
  Poster& operator=(const Poster&) = delete;

  /// A request that cannot begin has its outcome in the next Wait.
  void Start(const PostRequest& request);
  size_t in_flight() const { return calls_.size(); }
  /// Waits until a request has ended, until Wake, or for this long.
  std::vector<PostOutcome> Wait(absl::Duration time);
  /// Ends a Wait, or the next one. Threads: any.
  void Wake();
  /// Breaks all requests off, and returns their numbers.
  std::vector<int64_t> Abort();

 private:
  struct Call;

  explicit Poster(std::string ca_path, const RequestLimits& limits);
  std::vector<PostOutcome> TakeOutcomes();

  const std::string ca_path_;
  const RequestLimits limits_;
  void* const multi_;  // libcurl's, whose header stays out of this one
  std::map<void*, std::unique_ptr<Call>> calls_;
};

}  // namespace lumifold::webhooks
