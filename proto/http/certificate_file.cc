#include "proto/http/certificate_file.h"

#include <tuple>
#include <utility>

namespace lumifold::http {
namespace {

namespace ssl = boost::asio::ssl;

/// Null where it cannot be used.
std::shared_ptr<ssl::context> ContextOf(const std::string& path) {
  auto context = std::make_shared<ssl::context>(ssl::context::tls_server);
  boost::system::error_code error;
  std::ignore = context->use_certificate_chain_file(path, error);
  if (!error) std::ignore = context->use_private_key_file(path, ssl::context::pem, error);
  const bool is_usable =
      !error && SSL_CTX_set_min_proto_version(context->native_handle(), TLS1_2_VERSION) == 1;
  return is_usable ? context : nullptr;
}

bool IsSame(const struct stat& a, const struct stat& b) {
  return a.st_dev == b.st_dev && a.st_ino == b.st_ino && a.st_size == b.st_size &&
         a.st_mtim.tv_sec == b.st_mtim.tv_sec && a.st_mtim.tv_nsec == b.st_mtim.tv_nsec;
}

}  // namespace

std::shared_ptr<ssl::context> CertificateFile::Read() {
  struct stat now = {};
  if (stat(path_.c_str(), &now) != 0 || IsSame(now, last_)) return context_;
  if (std::shared_ptr<ssl::context> fresh = ContextOf(path_); fresh != nullptr) {
    context_ = std::move(fresh);
    last_ = now;
  }
  return context_;
}

}  // namespace lumifold::http
