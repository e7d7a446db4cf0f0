#pragma once

#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/string_body.hpp>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "absl/time/time.h"
#include "proto/http/handler_threads.h"
#include "proto/http/server.h"

namespace lumifold::http {

class Connection;

/// What the connections of a server share. Threads: that of input and output alone, but for `threads`.
struct Shared {
  const ServerOptions options;
  std::set<Connection*> connections = {};
  boost::asio::io_context io{1};
  HandlerThreads threads{options.limits.threads};
  bool is_stopping = false;
};

/// One connection, from its acceptance to its end. Whatever it waits for holds a reference to it: it is over
/// when it waits for nothing.
/// Threads: that of input and output. Handlers get references to members that do not change while they run.
class Connection final : public std::enable_shared_from_this<Connection> {
 public:
  using TlsContext = std::shared_ptr<boost::asio::ssl::context>;

  /// `shared` must outlive it. `context`: null in plain text.
  Connection(Shared* shared, boost::asio::ip::tcp::socket socket, TlsContext context);
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;
  ~Connection();

  void Start();
  /// Ends it: at once without a request, else after the answer.
  void Stop();
  /// Closes it if the server has waited for a whole request for this long.
  void CloseIfWaiting(absl::Duration patience);

 private:
  /// Bytes of a request.
  struct Incoming {
    explicit Incoming(size_t max_bytes) : buffer(max_bytes) {}

    boost::beast::flat_buffer buffer;  // received, not parsed
    std::optional<boost::beast::http::request_parser<boost::beast::http::string_body>> parser;
    size_t parsed_bytes = 0;
  };
  /// Bytes of an answer.
  struct Outgoing {
    std::string bytes;
    size_t sent = 0;
    size_t piece_end = 0;  // where the time of a write is extended
  };
  /// When the next piece of an answer is pulled.
  struct PieceClock {
    bool pauses = false;  // before a piece
    absl::Duration next_pause;
    uint64_t bytes_left = 0;  // of an answer that states its length
  };
  using Piece = absl::StatusOr<std::optional<std::string>>;
  using Step = void (Connection::*)();
  using Transferred = std::function<void(boost::system::error_code, size_t)>;

  /// Takes `step` after a time, in place of what was to be done before.
  void After(absl::Duration time, Step step);
  void CancelStep() { timer_.expires_at(boost::asio::steady_timer::time_point::max()); }
  void Close();

  void AwaitRequest();
  void Read();
  void Parse();
  /// The status that refuses the head of a request; nullopt: it is right.
  std::optional<int> HeadError() const;
  void CallHandler();
  /// Answers what is no request, and reads no more.
  void Refuse(int status);

  void Answer(Response response);
  void PullPiece();
  void SendPiece(const Piece& piece);
  void Send(std::string bytes);
  void SendMore();
  void ExtendWriteTime();
  void AfterSending();

  /// Closes when the caller has: closing a socket with bytes in it would take the answer back. When the
  /// server stops it does not wait for that.
  void CloseGently();
  void Discard();

  Shared& shared_;
  const Limits& limits_ = shared_.options.limits;
  boost::asio::ip::tcp::socket socket_;
  const TlsContext context_;
  const std::unique_ptr<boost::asio::ssl::stream<boost::asio::ip::tcp::socket&>> tls_;  // null in plain text
  boost::asio::steady_timer timer_;
  /// Since when a whole request is awaited; nullopt while one is answered.
  std::optional<absl::Time> awaits_since_;

  Incoming in_;
  Request request_;
  bool is_http11_ = false;
  bool keeps_alive_ = false;
  Response response_;
  PieceClock pieces_;
  Outgoing out_;
};

}  // namespace lumifold::http
