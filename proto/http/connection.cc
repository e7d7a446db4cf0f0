#include "proto/http/connection.h"

#include <algorithm>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/http/status.hpp>
#include <tuple>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::http {
namespace {

namespace net = boost::asio;
namespace beast = boost::beast::http;
using boost::system::error_code;

constexpr size_t kReadBytes = 4096;
/// What is written within Limits::write_time.
constexpr size_t kPieceBytes = 64 << 10;
/// For the other side to close a connection after its last answer.
constexpr absl::Duration kCloseTime = absl::Seconds(2);
/// For the rest of an answer to be sent when the server stops.
constexpr absl::Duration kStopTime = absl::Seconds(1);

std::string TextOf(boost::beast::string_view text) { return {text.data(), text.size()}; }

std::string ReasonOf(int status) {
  return TextOf(beast::obsolete_reason(static_cast<beast::status>(status)));
}

/// Status line and headers. `framing`: the headers about length and connection.
std::string HeadOf(const Response& response, const Headers& common, absl::string_view framing) {
  std::string head =
      absl::StrCat("HTTP/1.1 ", response.status, " ", ReasonOf(response.status), "\r\n", framing);
  if (!response.content_type.empty()) absl::StrAppend(&head, "Content-Type: ", response.content_type, "\r\n");
  for (const Headers* headers : {&common, &response.headers}) {
    for (const auto& [name, value] : *headers) absl::StrAppend(&head, name, ": ", value, "\r\n");
  }
  absl::StrAppend(&head, "\r\n");
  return head;
}

Response Failure(int status) {
  return {.status = status,
          .content_type = "text/plain; charset=utf-8",
          .body = absl::StrCat(ReasonOf(status), "\n")};
}

/// What a handler answers, and 500 where it throws.
Response Call(const ServerOptions& options, const Request& request) {
  try {
    return options.handler(request);
  } catch (...) {
    return Failure(500);
  }
}

absl::StatusOr<std::optional<std::string>> NextPiece(const Response& response) {
  try {
    return response.stream();
  } catch (...) {
    return absl::InternalError("the stream has thrown");
  }
}

}  // namespace

Connection::Connection(Shared* shared, net::ip::tcp::socket socket, TlsContext context)
    : shared_(*shared),
      socket_(std::move(socket)),
      context_(std::move(context)),
      tls_(context_ == nullptr
               ? nullptr
               : std::make_unique<net::ssl::stream<net::ip::tcp::socket&>>(socket_, *context_)),
      timer_(shared_.io),
      in_(limits_.header_bytes + kReadBytes) {
  shared_.connections.insert(this);
}

Connection::~Connection() { shared_.connections.erase(this); }

void Connection::After(absl::Duration time, Step step) {
  timer_.expires_after(absl::ToChronoNanoseconds(time));
  timer_.async_wait([self = shared_from_this(), step](error_code error) {
    // A wait that had ended when the timer was set again is no longer meant.
    if (!error && self->timer_.expiry() <= net::steady_timer::clock_type::now()) (self.get()->*step)();
  });
}

void Connection::Close() {
  error_code ignored;
  std::ignore = socket_.close(ignored);
  CancelStep();
}

void Connection::Start() {
  if (tls_ == nullptr) return AwaitRequest();
  awaits_since_ = rpc::MonotonicNow();
  After(limits_.handshake_time, &Connection::Close);
  tls_->async_handshake(net::ssl::stream_base::server, [self = shared_from_this()](error_code error) {
    if (error) return self->Close();
    self->AwaitRequest();
  });
}

void Connection::Stop() {
  if (awaits_since_.has_value()) {
    Close();
  } else if (pieces_.pauses) {
    CancelStep();
    SendPiece(Piece(std::nullopt));
  } else if (!out_.bytes.empty()) {
    ExtendWriteTime();
  }
}

void Connection::CloseIfWaiting(absl::Duration patience) {
  if (awaits_since_.has_value() && rpc::MonotonicNow() - *awaits_since_ >= patience) Close();
}

void Connection::AwaitRequest() {
  awaits_since_ = rpc::MonotonicNow();
  in_.parser.emplace();
  in_.parser->header_limit(static_cast<uint32_t>(limits_.header_bytes));
  in_.parser->body_limit(limits_.body_bytes);
  in_.parsed_bytes = 0;
  After(in_.buffer.size() == 0 ? limits_.idle_time : limits_.request_time, &Connection::Close);
  Parse();
}

void Connection::Read() {
  Transferred received = [self = shared_from_this()](error_code error, size_t bytes) {
    // The caller has closed, or its time is over: it expects no answer to half a request.
    if (error) return self->Close();
    const bool is_first = self->in_.parsed_bytes == 0 && self->in_.buffer.size() == 0;
    if (is_first) self->After(self->limits_.request_time, &Connection::Close);
    self->in_.buffer.commit(bytes);
    self->Parse();
  };
  const auto room = in_.buffer.prepare(kReadBytes);
  if (tls_ != nullptr) return tls_->async_read_some(room, std::move(received));
  socket_.async_read_some(room, std::move(received));
}

void Connection::Parse() {
  while (!in_.parser->is_done()) {
    if (in_.buffer.size() == 0) return Read();
    const bool had_head = in_.parser->is_header_done();
    error_code error;
    const size_t parsed = in_.parser->put(in_.buffer.data(), error);
    in_.buffer.consume(parsed);
    in_.parsed_bytes += parsed;
    // The parser's own limit is for each call: it takes complete lines, and counts anew.
    if (!had_head && in_.parsed_bytes + (error ? in_.buffer.size() : 0) > limits_.header_bytes)
      return Refuse(431);
    if (error == beast::error::need_more) return Read();
    if (error == beast::error::body_limit) return Refuse(413);
    if (error) return Refuse(error == beast::error::header_limit ? 431 : 400);
    if (had_head || !in_.parser->is_header_done()) continue;
    if (const std::optional<int> refusal = HeadError(); refusal.has_value()) return Refuse(*refusal);
  }
  CallHandler();
}

std::optional<int> Connection::HeadError() const {
  const auto& head = in_.parser->get();
  const boost::beast::string_view method = head.method_string();
  const bool is_method =
      std::all_of(method.begin(), method.end(), [](char c) { return absl::ascii_isupper(c); });
  if (!is_method || head.target().empty() || head.target().front() != '/') return 400;
  const size_t lengths = head.count(beast::field::content_length);
  if (head.count(beast::field::transfer_encoding) != 0) return lengths == 0 ? 411 : 400;
  const boost::beast::string_view length = head[beast::field::content_length];
  const bool is_number =
      std::all_of(length.begin(), length.end(), [](char c) { return absl::ascii_isdigit(c); });
  if (lengths > 1 || !is_number || head.count(beast::field::host) > 1) return 400;
  return std::nullopt;
}

void Connection::CallHandler() {
  awaits_since_.reset();
  CancelStep();
  auto message = in_.parser->release();
  is_http11_ = message.version() >= 11;
  keeps_alive_ = is_http11_ && message.keep_alive();
  const boost::beast::string_view target = message.target();
  const size_t query = std::min(target.find('?'), target.size());
  request_ = {.method = TextOf(message.method_string()),
              .path = TextOf(target.substr(0, query)),
              .query = query == target.size() ? "" : TextOf(target.substr(query + 1)),
              .headers = {},
              .body = std::move(message.body())};
  for (const auto& field : message)
    request_.headers.emplace_back(TextOf(field.name_string()), TextOf(field.value()));
  // The last reference is given up by the thread of input and output, which waits for the handler.
  shared_.threads.Run([self = shared_from_this(), waits = net::make_work_guard(shared_.io)]() mutable {
    net::io_context& io = self->shared_.io;
    Response response = Call(self->shared_.options, self->request_);
    net::post(io, [self = std::move(self), response = std::move(response)]() mutable {
      self->Answer(std::move(response));
    });
  });
}

void Connection::Refuse(int status) {
  keeps_alive_ = false;
  request_ = {};
  Answer(Failure(status));
}

void Connection::Answer(Response response) {
  response_ = std::move(response);
  pieces_.next_pause = absl::ZeroDuration();
  keeps_alive_ = keeps_alive_ && !shared_.is_stopping;
  std::string framing = keeps_alive_ ? "" : "Connection: close\r\n";
  if (response_.stream != nullptr && response_.stream_bytes.has_value()) {
    pieces_.bytes_left = *response_.stream_bytes;
    absl::StrAppend(&framing, "Content-Length: ", pieces_.bytes_left, "\r\n");
  } else if (response_.stream != nullptr) {
    // Without chunks the body ends with the connection.
    if (is_http11_) framing += "Transfer-Encoding: chunked\r\n";
  } else if (response_.status != 204) {
    absl::StrAppend(&framing, "Content-Length: ", response_.body.size(), "\r\n");
  }
  const bool has_body = request_.method != "HEAD";
  if (!has_body) response_.stream = nullptr;
  Send(HeadOf(response_, shared_.options.headers, framing) + (has_body ? response_.body : ""));
}

void Connection::PullPiece() {
  pieces_.pauses = false;
  shared_.threads.Run([self = shared_from_this(), waits = net::make_work_guard(shared_.io)]() mutable {
    net::io_context& io = self->shared_.io;
    Piece piece = NextPiece(self->response_);
    net::post(io, [self = std::move(self), piece = std::move(piece)] { self->SendPiece(piece); });
  });
}

void Connection::SendPiece(const Piece& piece) {
  const bool states_length = response_.stream_bytes.has_value();
  const bool is_end = piece.ok() && (!piece->has_value() || shared_.is_stopping);
  const size_t bytes = piece.ok() && piece->has_value() && !is_end ? (*piece)->size() : 0;
  const bool has_other_length =
      states_length && (bytes > pieces_.bytes_left || (is_end && pieces_.bytes_left > 0));
  if (!piece.ok() || has_other_length) return Close();
  const bool is_chunked = is_http11_ && !states_length;
  if (is_end) {
    response_.stream = nullptr;
    return Send(is_chunked ? "0\r\n\r\n" : "");
  }
  pieces_.next_pause = response_.pause;
  pieces_.bytes_left -= states_length ? bytes : 0;
  if (bytes == 0 || !is_chunked) return Send(**piece);
  Send(absl::StrCat(absl::Hex(bytes), "\r\n", **piece, "\r\n"));
}

void Connection::Send(std::string bytes) {
  out_.bytes = std::move(bytes);
  out_.sent = 0;
  out_.piece_end = 0;
  SendMore();
}

void Connection::SendMore() {
  if (out_.sent == out_.bytes.size()) return AfterSending();
  if (out_.sent >= out_.piece_end) ExtendWriteTime();
  Transferred sent = [self = shared_from_this()](error_code error, size_t bytes) {
    if (error) return self->Close();
    self->out_.sent += bytes;
    self->SendMore();
  };
  const auto rest = net::buffer(out_.bytes.data() + out_.sent, out_.bytes.size() - out_.sent);
  if (tls_ != nullptr) return tls_->async_write_some(rest, std::move(sent));
  socket_.async_write_some(rest, std::move(sent));
}

void Connection::ExtendWriteTime() {
  After(shared_.is_stopping ? kStopTime : limits_.write_time, &Connection::Close);
  out_.piece_end = shared_.is_stopping ? out_.bytes.size() : out_.sent + kPieceBytes;
}

void Connection::AfterSending() {
  out_.bytes.clear();
  if (response_.stream != nullptr) {
    if (shared_.is_stopping) return SendPiece(Piece(std::nullopt));
    pieces_.pauses = true;
    return After(pieces_.next_pause, &Connection::PullPiece);
  }
  response_ = {};
  if (keeps_alive_ && !shared_.is_stopping) return AwaitRequest();
  CloseGently();
}

void Connection::CloseGently() {
  if (shared_.is_stopping) return Close();
  awaits_since_ = rpc::MonotonicNow();
  After(kCloseTime, &Connection::Close);
  if (tls_ == nullptr) return Discard();
  tls_->async_shutdown([self = shared_from_this()](error_code) { self->Discard(); });
}

void Connection::Discard() {
  error_code ignored;
  std::ignore = socket_.shutdown(net::ip::tcp::socket::shutdown_send, ignored);
  in_.buffer.clear();
  socket_.async_read_some(in_.buffer.prepare(kReadBytes),
                          [self = shared_from_this()](error_code error, size_t) {
                            if (error) return self->Close();
                            self->Discard();
                          });
}

}  // namespace lumifold::http
