#include "client/autoscale/http_call.h"

#include <curl/curl.h>

#include <memory>

#include "absl/strings/str_cat.h"

namespace lumifold::autoscale {
namespace {

constexpr size_t kMaxBodyBytes = size_t{64} << 20;

/// Called by libcurl with a piece of the body; another count than `size * count` ends the call.
size_t TakePiece(char* piece, size_t size, size_t count, void* body) {
  auto* const text = static_cast<std::string*>(body);
  if (text->size() + size * count > kMaxBodyBytes) return 0;
  text->append(piece, size * count);
  return size * count;
}

struct FreeList {
  void operator()(curl_slist* list) const { curl_slist_free_all(list); }
};

void SetOptions(CURL* call, const HttpRequest& request, const curl_slist* headers) {
  curl_easy_setopt(call, CURLOPT_URL, request.url.c_str());
  curl_easy_setopt(call, CURLOPT_PROTOCOLS_STR, "http,https");
  curl_easy_setopt(call, CURLOPT_CUSTOMREQUEST, request.method.c_str());
  curl_easy_setopt(call, CURLOPT_HTTPHEADER, headers);
  curl_easy_setopt(call, CURLOPT_TIMEOUT_MS, static_cast<long>(absl::ToInt64Milliseconds(request.timeout)));
  curl_easy_setopt(call, CURLOPT_NOSIGNAL, 1L);
  curl_easy_setopt(call, CURLOPT_PROXY, "");
  curl_easy_setopt(call, CURLOPT_WRITEFUNCTION, TakePiece);
  if (!request.ca_file.empty()) curl_easy_setopt(call, CURLOPT_CAINFO, request.ca_file.c_str());
  if (request.method == "GET") return;
  curl_easy_setopt(call, CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(request.body.size()));
  curl_easy_setopt(call, CURLOPT_POSTFIELDS, request.body.data());
}

}  // namespace

absl::StatusOr<HttpAnswer> CallHttp(const HttpRequest& request) {
  const std::unique_ptr<CURL, decltype(&curl_easy_cleanup)> call(curl_easy_init(), curl_easy_cleanup);
  std::unique_ptr<curl_slist, FreeList> headers;
  for (const std::string& header : request.headers) {
    curl_slist* const longer = curl_slist_append(headers.get(), header.c_str());
    if (longer == nullptr) return absl::UnavailableError("no memory for a call");
    static_cast<void>(headers.release());
    headers.reset(longer);
  }
  if (call == nullptr) return absl::UnavailableError("no memory for a call");
  HttpAnswer answer;
  SetOptions(call.get(), request, headers.get());
  curl_easy_setopt(call.get(), CURLOPT_WRITEDATA, &answer.body);
  if (const CURLcode error = curl_easy_perform(call.get()); error != CURLE_OK)
    return absl::UnavailableError(absl::StrCat(request.url, ": ", curl_easy_strerror(error)));
  long code = 0;
  curl_easy_getinfo(call.get(), CURLINFO_RESPONSE_CODE, &code);
  answer.code = static_cast<int>(code);
  return answer;
}

std::string UrlEscape(const std::string& text) {
  const std::unique_ptr<char, decltype(&curl_free)> escaped(
      curl_easy_escape(nullptr, text.c_str(), static_cast<int>(text.size())), curl_free);
  return escaped == nullptr ? "" : escaped.get();
}

}  // namespace lumifold::autoscale
