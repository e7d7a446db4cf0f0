#include "server/child/child_task.h"

#include <signal.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <new>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "filter/image/exr_io.h"
#include "filter/image/memory.h"
#include "filter/manifold/filter_device.h"
#include "proto/device/device_process.h"
#include "proto/rpc/byte_stream.h"
#include "proto/sandbox/sandbox.h"
#include "server/ledger/open_job_store.h"

namespace lumifold::server {
namespace {

constexpr int kFailed = 1;
/// Of ChildProcess::Run, before the arguments of the task.
constexpr size_t kCommonArguments = 4;

/// Tells the parent of a share that is further by a per cent.
class ShareWriter {
 public:
  void operator()(double share) {
    const int percent = std::clamp(static_cast<int>(100 * share), 0, 100);
    if (percent <= told_) return;
    told_ = percent;
    std::cout << static_cast<char>(kNoPercent + percent) << std::flush;
  }

 private:
  int told_ = 0;
};

/// The filter reads units, writes results and reads the ledger; the rest of the data folder has secrets. Only
/// a ledger elsewhere needs the network.
absl::Status SandboxThisProcess(const DataFolder& folder, const std::string& store,
                                uint64_t memory_limit_bytes) {
  sandbox::SandboxOptions options = {
      .keep_file_access = true,
      .memory_bytes = memory_limit_bytes,
      // The coordinator has the ledger open, so that its files are there and stay.
      .writable = {folder.root() + "/film", folder.root() + "/results", folder.LedgerPath(),
                   folder.LedgerPath() + "-wal", folder.LedgerPath() + "-shm"},
  };
  if (!store.empty() && store != ledger::kSqliteStore) {
    options.network = true;
    options.readable = {"/var/run/postgresql"};
    if (const char* const home = std::getenv("HOME"); home != nullptr)
      options.readable.insert(options.readable.end(),
                              {absl::StrCat(home, "/.postgresql"), absl::StrCat(home, "/.pgpass")});
    if (const char* const file = std::getenv("PGPASSFILE"); file != nullptr)
      options.readable.emplace_back(file);
  }
  return sandbox::EnterSandbox(options).status();
}

/// The parent's device; null: it has none. The parent tells of its failure.
std::shared_ptr<filter::FilterDevice> DeviceOfParent(absl::string_view argument) {
  if (!absl::ConsumePrefix(&argument, kOnDevice)) return nullptr;
  return device::MakeDeviceLink(rpc::FileHandle(STDIN_FILENO), std::string(argument),
                                device::DeviceProcessOptions::DefaultTimeLimit(), [] {});
}

absl::StatusOr<std::string> RunInChild(const std::vector<std::string>& arguments, int niceness,
                                       const ChildBody& body) {
  int threads = 0;
  uint64_t memory_limit_bytes = 0;
  if (arguments.size() < kCommonArguments || !absl::SimpleAtoi(arguments[1], &threads) || threads < 1 ||
      !absl::SimpleAtoi(arguments[2], &memory_limit_bytes))
    return absl::InvalidArgumentError("only the coordinator starts this command");
  // If the coordinator is killed, this frame is finished again after its restart.
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const bool is_urgent = arguments.back() == kUrgent;
  if (absl::Status status = sandbox::YieldToOthers(is_urgent ? 0 : niceness); !status.ok()) return status;
  const DataFolder folder(arguments[0]);
  setenv("SQLITE_TMPDIR", (folder.root() + "/film").c_str(),
         /*overwrite=*/1);  // the sandbox leaves no other folder
  const char* const variable = std::getenv(ledger::kStoreVariable);
  const std::string store_name = variable == nullptr ? "" : variable;
  const absl::StatusOr<std::unique_ptr<ledger::JobStore>> store =
      ledger::OpenJobStore(store_name, folder.LedgerPath());
  if (!store.ok()) return store.status();
  // After the store: its address may name certificates anywhere.
  if (absl::Status status = SandboxThisProcess(folder, store_name, memory_limit_bytes); !status.ok())
    return status;
  KeepFreedMemory();
  SetExrThreads(threads);
  const std::unique_ptr<TaskPool> pool =
      filter::WithDevice(MakeTaskPool(threads), DeviceOfParent(arguments[3]));
  try {
    return body({folder,
                 **store,
                 pool.get(),
                 ShareWriter(),
                 {arguments.begin() + kCommonArguments, arguments.end()}});
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(
        absl::StrCat("out of memory (limit ", memory_limit_bytes >> 20, " MiB, 0 for none)"));
  }
}

}  // namespace

int RunChildTask(const std::vector<std::string>& arguments, int niceness, const ChildBody& body) {
  const absl::StatusOr<std::string> answer = RunInChild(arguments, niceness, body);
  if (answer.ok()) {
    std::cout << kAnswer << *answer << std::flush;
    return 0;
  }
  std::cout << kAnswer << static_cast<int>(answer.status().code()) << ' '
            << std::string(answer.status().message()) << std::flush;
  return kFailed;
}

}  // namespace lumifold::server
