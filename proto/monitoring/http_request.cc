#include "proto/monitoring/http_request.h"

#include <algorithm>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace lumifold::monitoring {
namespace {

/// The content type of Prometheus' text format.
constexpr char kContentType[] = "text/plain; version=0.0.4; charset=utf-8";

std::string Response(absl::string_view status, absl::string_view body, absl::string_view more_headers = "") {
  return absl::StrCat("HTTP/1.1 ", status, "\r\nContent-Type: ", kContentType,
                      "\r\nContent-Length: ", body.size(), "\r\nConnection: close\r\n", more_headers, "\r\n",
                      body);
}

bool IsToken(absl::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) { return c >= 'A' && c <= 'Z'; });
}

}  // namespace

std::optional<std::string> Answer(absl::string_view request, absl::string_view path,
                                  const std::function<std::string()>& text) {
  const bool is_complete = absl::StrContains(request, "\r\n\r\n");
  if (!is_complete && request.size() < kMaxRequestBytes) return std::nullopt;
  if (!is_complete) return Response("431 Request Header Fields Too Large", "the request is too long\n");
  const std::vector<absl::string_view> line =
      absl::StrSplit(request.substr(0, request.find("\r\n")), absl::MaxSplits(' ', 3));
  if (line.size() != 3 || !IsToken(line[0]) || !absl::StartsWith(line[1], "/") ||
      !absl::StartsWith(line[2], "HTTP/1."))
    return Response("400 Bad Request", "this is not HTTP/1\n");
  if (line[1].substr(0, line[1].find('?')) != path)
    return Response("404 Not Found", absl::StrCat("here is ", path, " only\n"));
  if (line[0] == "GET") return Response("200 OK", text());
  if (line[0] != "HEAD")
    return Response("405 Method Not Allowed", "GET and HEAD only\n", "Allow: GET, HEAD\r\n");
  std::string response = Response("200 OK", text());
  response.resize(response.find("\r\n\r\n") + 4);
  return response;
}

}  // namespace lumifold::monitoring
