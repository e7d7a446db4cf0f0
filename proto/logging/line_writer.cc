#include "proto/logging/line_writer.h"

#include <string>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "proto/threads/event.h"

namespace lumifold::logging {

/// What the writer and its thread share.
struct LineWriter::Queue {
  absl::Mutex mutex;
  std::string lines ABSL_GUARDED_BY(mutex);
  uint64_t dropped ABSL_GUARDED_BY(mutex) = 0;  // after `lines`
  bool is_ending ABSL_GUARDED_BY(mutex) = false;
  threads::Event finished;  // everything is written, and nothing more will come

  bool HasWork() const ABSL_SHARED_LOCKS_REQUIRED(mutex) {
    return is_ending || !lines.empty() || dropped > 0;
  }

  void WriteAll(File& file) ABSL_LOCKS_EXCLUDED(mutex) {
    while (true) {
      std::string batch;
      uint64_t batch_dropped = 0;
      {
        absl::MutexLock lock(&mutex);
        mutex.Await(absl::Condition(this, &Queue::HasWork));
        batch = std::exchange(lines, {});
        batch_dropped = std::exchange(dropped, 0);
      }
      if (batch.empty() && batch_dropped == 0) break;
      file.Write(batch, batch_dropped);
    }
    finished.Notify();
  }
};

LineWriter::LineWriter(const Options& options, std::unique_ptr<File> file)
    : options_(options), queue_(std::make_shared<Queue>()) {
  std::thread([queue = queue_, file = std::move(file)] { queue->WriteAll(*file); }).detach();
}

LineWriter::~LineWriter() {
  {
    absl::MutexLock lock(&queue_->mutex);
    queue_->is_ending = true;
  }
  queue_->finished.WaitFor(options_.flush_time);
}

void LineWriter::Add(std::string_view line) {
  absl::MutexLock lock(&queue_->mutex);
  if (queue_->dropped > 0 || queue_->lines.size() + line.size() > options_.max_waiting_bytes) {
    ++queue_->dropped;
    return;
  }
  queue_->lines += line;
}

}  // namespace lumifold::logging
