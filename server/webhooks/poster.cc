#include "server/webhooks/poster.h"

#include <curl/curl.h>
#include <sys/socket.h>

#include <array>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/check.h"
#include "filter/image/file_io.h"
#include "proto/rpc/version.h"

namespace lumifold::webhooks {
namespace {

constexpr long kFirstRefused = 300;
constexpr long kFirstAccepted = 200;

/// Sockets are not for the child processes of the coordinator.
curl_socket_t OpenSocket(void*, curlsocktype, curl_sockaddr* address) {
  return socket(address->family, address->socktype | SOCK_CLOEXEC, address->protocol);
}

/// Once for the process, before there are threads that use the library.
bool StartLibrary() {
  static const CURLcode result = curl_global_init(CURL_GLOBAL_DEFAULT);
  return result == CURLE_OK;
}

long Milliseconds(absl::Duration time) { return static_cast<long>(absl::ToInt64Milliseconds(time)); }

}  // namespace

/// A request in flight.
struct Poster::Call {
  struct FreeList {
    void operator()(curl_slist* list) const { curl_slist_free_all(list); }
  };

  /// Counts what arrives, and keeps nothing.
  static size_t Discard(const char*, size_t size, size_t count, void* call) {
    auto* const self = static_cast<Call*>(call);
    const size_t bytes = size * count;
    if (bytes > self->answer_bytes_left) return 0;  // ends the request
    self->answer_bytes_left -= bytes;
    return bytes;
  }

  int64_t number = 0;
  std::string body;
  std::unique_ptr<curl_slist, FreeList> headers;
  size_t answer_bytes_left = 0;
  std::array<char, CURL_ERROR_SIZE> error = {};
};

absl::StatusOr<std::unique_ptr<Poster>> Poster::Open(const std::string& ca_path,
                                                     const RequestLimits& limits) {
  if (!StartLibrary()) return absl::UnavailableError("webhooks: libcurl cannot start");
  if (!ca_path.empty()) {
    constexpr int64_t kMaxBytes = int64_t{4} << 20;
    if (absl::Status status = ReadFile(ca_path, kMaxBytes).status(); !status.ok()) return status;
  }
  std::unique_ptr<Poster> poster(new Poster(ca_path, limits));
  if (poster->multi_ == nullptr) return absl::UnavailableError("webhooks: libcurl cannot start");
  return poster;
}

Poster::Poster(std::string ca_path, const RequestLimits& limits)
    : ca_path_(std::move(ca_path)), limits_(limits), multi_(curl_multi_init()) {}

Poster::~Poster() {
  Abort();
  curl_multi_cleanup(multi_);
}

void Poster::Start(const PostRequest& request) {
  auto call = std::make_unique<Call>();
  call->number = request.number;
  call->body = request.body;
  call->answer_bytes_left = limits_.answer_bytes;
  for (const std::string& header : request.headers) {
    curl_slist* const longer = curl_slist_append(call->headers.get(), header.c_str());
    // Without memory there is none; the receiver refuses what lacks a header.
    if (call->headers == nullptr) call->headers.reset(longer);
  }
  CURL* const curl = curl_easy_init();
  LUMIFOLD_CHECK(curl != nullptr);  // out of memory
  const auto set = [curl](CURLoption option, auto value) { curl_easy_setopt(curl, option, value); };
  set(CURLOPT_URL, request.url.c_str());
  set(CURLOPT_PROTOCOLS_STR, "http,https");
  set(CURLOPT_PROXY, "");
  set(CURLOPT_FOLLOWLOCATION, 0L);
  set(CURLOPT_HTTP_VERSION, long{CURL_HTTP_VERSION_1_1});
  set(CURLOPT_USERAGENT, absl::StrCat("lumifold/", std::string(rpc::kVersion)).c_str());
  set(CURLOPT_HTTPHEADER, call->headers.get());
  set(CURLOPT_POSTFIELDSIZE, static_cast<long>(call->body.size()));
  set(CURLOPT_POSTFIELDS, call->body.data());
  set(CURLOPT_CONNECTTIMEOUT_MS, Milliseconds(limits_.connect_time));
  set(CURLOPT_TIMEOUT_MS, Milliseconds(limits_.time));
  set(CURLOPT_NOSIGNAL, 1L);
  set(CURLOPT_QUICK_EXIT, 1L);  // does not wait for a name server
  set(CURLOPT_OPENSOCKETFUNCTION, &OpenSocket);
  set(CURLOPT_WRITEFUNCTION, &Call::Discard);
  set(CURLOPT_WRITEDATA, call.get());
  set(CURLOPT_ERRORBUFFER, call->error.data());
  if (!ca_path_.empty()) set(CURLOPT_CAINFO, ca_path_.c_str());
  calls_.emplace(curl, std::move(call));
  curl_multi_add_handle(multi_, curl);
}

std::vector<PostOutcome> Poster::Wait(absl::Duration time) {
  int running = 0;
  curl_multi_perform(multi_, &running);
  std::vector<PostOutcome> outcomes = TakeOutcomes();
  if (!outcomes.empty()) return outcomes;
  curl_multi_poll(multi_, nullptr, 0, static_cast<int>(Milliseconds(time)), nullptr);
  curl_multi_perform(multi_, &running);
  return TakeOutcomes();
}

std::vector<PostOutcome> Poster::TakeOutcomes() {
  std::vector<PostOutcome> outcomes;
  int left = 0;
  while (const CURLMsg* const message = curl_multi_info_read(multi_, &left)) {
    if (message->msg != CURLMSG_DONE) continue;
    CURL* const curl = message->easy_handle;
    const CURLcode result = message->data.result;
    const auto call = calls_.extract(curl);
    long answer = 0;
    curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &answer);
    PostOutcome& outcome = outcomes.emplace_back();
    outcome.number = call.mapped()->number;
    // The status is the answer: what follows it may be cut off.
    const bool is_accepted = answer >= kFirstAccepted && answer < kFirstRefused;
    if (!is_accepted && answer > 0) {
      outcome.status = absl::UnavailableError(absl::StrCat("the receiver has answered with ", answer));
    } else if (!is_accepted) {
      const char* const error = call.mapped()->error.data();
      outcome.status = absl::UnavailableError(*error != '\0' ? error : curl_easy_strerror(result));
    }
    curl_multi_remove_handle(multi_, curl);
    curl_easy_cleanup(curl);
  }
  return outcomes;
}

void Poster::Wake() { curl_multi_wakeup(multi_); }

std::vector<int64_t> Poster::Abort() {
  std::vector<int64_t> numbers;
  for (const auto& [curl, call] : calls_) {
    numbers.push_back(call->number);
    curl_multi_remove_handle(multi_, curl);
    curl_easy_cleanup(curl);
  }
  calls_.clear();
  return numbers;
}

}  // namespace lumifold::webhooks
