#pragma once

#include <sys/stat.h>

#include <boost/asio/ssl/context.hpp>
#include <memory>
#include <string>
#include <utility>

namespace lumifold::http {

/// A PEM file with key and certificates, which is read again when it changes: they are renewed while the
/// server runs.
/// Threads: one at a time.
class CertificateFile {
 public:
  explicit CertificateFile(std::string path) : path_(std::move(path)) {}

  /// The file's key and certificates; the last ones that could be used where the file cannot, as while it is
  /// being written; null: there were none.
  std::shared_ptr<boost::asio::ssl::context> Read();

 private:
  const std::string path_;
  struct stat last_ = {};
  std::shared_ptr<boost::asio::ssl::context> context_;
};

}  // namespace lumifold::http
