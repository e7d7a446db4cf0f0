#include "proto/monitoring/endpoint.h"

#include <prometheus/collectable.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <iterator>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "proto/http/message.h"
#include "proto/rpc/credentials.h"
#include "proto/sockets/listening_sockets.h"

namespace lumifold::monitoring {
namespace {

constexpr char kPath[] = "/metrics";
constexpr char kDefaultHost[] = "127.0.0.1";
/// The content type of Prometheus' text format.
constexpr char kContentType[] = "text/plain; version=0.0.4; charset=utf-8";

absl::StatusOr<std::string> CompleteAddress(const std::string& address) {
  const bool has_host = absl::StrContains(address, ":") && !absl::StartsWith(address, ":");
  std::string complete =
      has_host ? address : absl::StrCat(kDefaultHost, absl::StartsWith(address, ":") ? "" : ":", address);
  rpc::HostAndPort parsed;
  if (absl::Status status = rpc::ParseHostAndPort(complete, &parsed); !status.ok()) return status;
  return complete;
}

class EndpointImpl final : public Endpoint {
 public:
  explicit EndpointImpl(EndpointOptions options) : options_(std::move(options)) {}
  absl::Status Open();

 private:
  http::Response Answer(const http::Request& request);
  const std::string& Text();

  const EndpointOptions options_;
  // Used by the thread of the handler only.
  std::string text_;
  absl::Time text_time_ = absl::InfinitePast();
  std::unique_ptr<http::Server> server_;  // last: its threads use the members above
};

absl::Status EndpointImpl::Open() {
  absl::StatusOr<std::unique_ptr<http::Server>> server =
      http::Server::Start({.listening = &options_.sockets->listening,
                           .limits = options_.limits,
                           .handler = [this](const http::Request& request) { return Answer(request); }});
  if (!server.ok()) return server.status();
  server_ = *std::move(server);
  return absl::OkStatus();
}

http::Response EndpointImpl::Answer(const http::Request& request) {
  if (request.path != kPath) return {404, kContentType, absl::StrCat("here is ", kPath, " only\n")};
  if (request.method != "GET" && request.method != "HEAD")
    return {405, kContentType, "GET and HEAD only\n", {{"Allow", "GET, HEAD"}}};
  return {200, kContentType, Text()};
}

const std::string& EndpointImpl::Text() {
  const absl::Time now = options_.now();
  if (now < text_time_ + options_.freshness) return text_;
  std::vector<prometheus::MetricFamily> families;
  for (const std::shared_ptr<prometheus::Collectable>& source : options_.sources) {
    std::vector<prometheus::MetricFamily> collected = source->Collect();
    std::move(collected.begin(), collected.end(), std::back_inserter(families));
  }
  text_ = prometheus::TextSerializer().Serialize(families);
  text_time_ = now;
  return text_;
}

}  // namespace

absl::StatusOr<EndpointSockets> ListenForMetrics(const std::string& address) {
  const absl::StatusOr<std::string> complete = CompleteAddress(address);
  if (!complete.ok()) return complete.status();
  absl::StatusOr<sockets::ListeningSockets> listening = sockets::ListenAt(*complete);
  if (!listening.ok()) return listening.status();
  return EndpointSockets{absl::StrCat(complete->substr(0, complete->rfind(':')), ":", listening->port),
                         std::move(listening->sockets)};
}

absl::StatusOr<std::unique_ptr<Endpoint>> Endpoint::Start(EndpointOptions options) {
  auto endpoint = std::make_unique<EndpointImpl>(std::move(options));
  if (absl::Status status = endpoint->Open(); !status.ok()) return status;
  return endpoint;
}

}  // namespace lumifold::monitoring
