#include "proto/http/handler_threads.h"

#include <system_error>
#include <utility>

namespace lumifold::http {

HandlerThreads::HandlerThreads(size_t most) : most_(most) {
  absl::MutexLock lock(&mutex_);
  threads_.emplace_back([this] { Loop(); });
}

HandlerThreads::~HandlerThreads() {
  std::vector<std::thread> threads;
  {
    absl::MutexLock lock(&mutex_);
    is_ending_ = true;
    threads.swap(threads_);
  }
  for (std::thread& thread : threads) thread.join();
}

void HandlerThreads::Run(std::function<void()> work) {
  absl::MutexLock lock(&mutex_);
  queue_.push_back(std::move(work));
  if (idle_ >= queue_.size() || threads_.size() >= most_) return;
  try {
    threads_.emplace_back([this] { Loop(); });
  } catch (const std::system_error&) {
    return;  // the work waits for a thread that there is
  }
}

void HandlerThreads::Loop() {
  while (true) {
    std::function<void()> work;
    {
      absl::MutexLock lock(&mutex_);
      ++idle_;
      mutex_.Await(absl::Condition(this, &HandlerThreads::HasWork));
      --idle_;
      if (queue_.empty()) return;
      work = std::move(queue_.front());
      queue_.pop_front();
    }
    work();
  }
}

}  // namespace lumifold::http
