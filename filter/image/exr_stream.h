#pragma once

#include <IexBaseExc.h>
#include <ImfIO.h>

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "filter/image/file_io.h"

namespace lumifold {

/// An AtomicFile as a stream of OpenEXR. It keeps the first error, because OpenEXR's destructors ignore them.
class ExrFileStream final : public Imf::OStream {
 public:
  ExrFileStream(const std::string& path, AtomicFile* file) : Imf::OStream(path.c_str()), file_(file) {}

  void write(const char bytes[], int count) override {
    if (status_.ok()) status_ = file_->Write(position_, {bytes, static_cast<size_t>(count)});
    if (!status_.ok()) throw Iex::IoExc(std::string(status_.message()));
    position_ += static_cast<uint64_t>(count);
  }
  uint64_t tellp() override { return position_; }
  void seekp(uint64_t position) override { position_ = position; }

  const absl::Status& status() const { return status_; }

 private:
  AtomicFile* const file_;
  uint64_t position_ = 0;
  absl::Status status_;
};

}  // namespace lumifold
