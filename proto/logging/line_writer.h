#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string_view>

#include "absl/time/time.h"

namespace lumifold::logging {

/// Lines on their way to a file that may hang: a bounded queue, and a thread that writes what waits, in
/// order. Threads: safe.
class LineWriter {
 public:
  /// What the thread writes to.
  class File {
   public:
    virtual ~File() = default;
    /// Writes whole lines; may block. `dropped`: how many did not fit into the queue after them, and before
    /// the lines of the next call.
    virtual void Write(std::string_view lines, uint64_t dropped) = 0;
  };
  struct Options {
    size_t max_waiting_bytes = 0;
    /// How long the end of the writer waits for what waits.
    absl::Duration flush_time;
  };

  /// The file belongs to the thread, which outlives the writer where a write does not return.
  LineWriter(const Options& options, std::unique_ptr<File> file);
  LineWriter(const LineWriter&) = delete;
  LineWriter& operator=(const LineWriter&) = delete;
  ~LineWriter();

  /// Takes a line, with its end; never waits for the file. A line that does not fit is dropped and counted,
  /// and so are all after it until the thread takes what waits.
  void Add(std::string_view line);

 private:
  struct Queue;

  const Options options_;
  const std::shared_ptr<Queue> queue_;
};

}  // namespace lumifold::logging
