#include "server/assets/asset_checks.h"

namespace lumifold::server {
namespace {

/// Assets that are read at a time. With fewer, a few large ones delay the small ones behind them; more
/// compete for the disk.
constexpr int kCheckThreads = 4;

absl::Status Stopping() { return absl::UnavailableError("the coordinator is stopping"); }

}  // namespace

AssetChecks::AssetChecks(AssetStore* assets) : assets_(assets) {
  for (int i = 0; i < kCheckThreads; ++i) threads_.emplace_back([this] { Run(); });
}

AssetChecks::~AssetChecks() { Stop(); }

void AssetChecks::Check(const std::set<std::string>& sha256, Done done) {
  const auto waiter = std::make_shared<Waiter>();
  absl::Status status;
  {
    absl::MutexLock lock(&mutex_);
    if (stopping_) status = Stopping();
    for (const std::string& name : sha256) {
      if (!status.ok() || !assets_->NeedsCheck(name)) continue;
      const auto [waiting, is_new] = waiters_.try_emplace(name);
      if (is_new) queue_.emplace(assets_->SizeOf(name), name);
      waiting->second.push_back(waiter);
      ++waiter->unchecked;
    }
    waiter->done = done;
    if (waiter->unchecked > 0) return;
  }
  done(status);
}

void AssetChecks::Recheck(const std::string& sha256, Done done) {
  assets_->Invalidate(sha256);
  Check({sha256}, std::move(done));
}

void AssetChecks::Run() {
  while (true) {
    std::string sha256;
    {
      absl::MutexLock lock(&mutex_);
      mutex_.Await(absl::Condition(this, &AssetChecks::HasWork));
      if (stopping_) return;
      sha256 = queue_.begin()->second;
      queue_.erase(queue_.begin());
    }
    assets_->Has(sha256);  // a damaged asset is missing from now on
    std::vector<std::shared_ptr<Waiter>> ready;
    {
      absl::MutexLock lock(&mutex_);
      ready = TakeReady(sha256);
    }
    for (const std::shared_ptr<Waiter>& waiter : ready) waiter->done(absl::OkStatus());
  }
}

std::vector<std::shared_ptr<AssetChecks::Waiter>> AssetChecks::TakeReady(const std::string& sha256) {
  std::vector<std::shared_ptr<Waiter>> ready;
  const auto found = waiters_.find(sha256);
  if (found == waiters_.end()) return ready;  // Stop has told them
  for (const std::shared_ptr<Waiter>& waiter : found->second) {
    if (--waiter->unchecked == 0) ready.push_back(waiter);
  }
  waiters_.erase(found);
  return ready;
}

void AssetChecks::Stop() {
  std::set<std::shared_ptr<Waiter>> waiting;
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
    for (const auto& [sha256, waiters] : waiters_) waiting.insert(waiters.begin(), waiters.end());
    waiters_.clear();
    queue_.clear();
  }
  assets_->StopChecks();
  for (const std::shared_ptr<Waiter>& waiter : waiting) waiter->done(Stopping());
  for (std::thread& thread : threads_) {
    if (thread.joinable()) thread.join();
  }
}

}  // namespace lumifold::server
