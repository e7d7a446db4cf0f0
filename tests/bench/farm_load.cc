// Load on a real coordinator, or on several over one PostgreSQL (LUMIFOLD_STORE): processes of their own, N
// workers over real sockets that answer each lease with a unit that is ready. Prints one "name value" pair a
// line. Exits with 1 where the coordinator refused a unit, ended a stream or committed nothing.
#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "proto/rpc/monotonic.h"
#include "proto/threads/event.h"
#include "server/job/job_spec.h"
#include "server/job/tile_grid.h"
#include "tests/bench/farm_load_access.h"
#include "tests/bench/farm_load_results.h"
#include "tests/bench/farm_load_server.h"
#include "tests/bench/farm_load_worker.h"

namespace lumifold::bench {
namespace {

/// Interval of the workers' heartbeats.
constexpr absl::Duration kHeartbeat = absl::Seconds(5);
/// Limit of the waits for workers and units.
constexpr absl::Duration kPatience = absl::Minutes(10);
/// Bytes between two fdatasync when the disk's own limit is measured: the committer's largest batch of 256
/// units of 140 KiB.
constexpr size_t kSyncedBytes = size_t{36} << 20;
/// Passes of a load job: half an hour at 2000 units/s of 1024 tiles. Four times as many are more units than a
/// frame of 64x64 tiles may have.
constexpr int kPasses = 4096;
constexpr double kMega = 1e6;

struct Flags {
  std::string measure = "units";
  int workers = 8;
  int slots = 2;
  int jobs = 1;
  int coordinators = 1;
  double seconds = 10;
  int size = 1024;
  int tile = 32;
  int pass_samples = 2;
  std::string scene;
  bool float32 = false;
  int64_t units = 100'000;
  int frames = 24;
  int result_mb = 30;
  std::string folder = std::filesystem::temp_directory_path().string();
  bool tls = false;
  std::string server =
      (std::filesystem::read_symlink("/proc/self/exe").parent_path() / "lumifold-server").string();
};

void AddFlags(CLI::App* app, Flags* flags) {
  app->add_option(
         "--measure", flags->measure,
         "units: rate, times and memory under load; frames: what the coordinator does for --frames frames of "
         "one pass that workers finish; kept: the same where workers keep the frames; restart: time until a "
         "killed coordinator with --units committed units listens again; list: time of a page of --jobs jobs")
      ->check(CLI::IsMember({"units", "frames", "kept", "restart", "list"}))
      ->capture_default_str();
  app->add_option("--workers", flags->workers)->check(CLI::Range(1, 10'000))->capture_default_str();
  app->add_option("--slots", flags->slots, "Slots of a worker")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app->add_option("--jobs", flags->jobs)->check(CLI::Range(1, 1'000'000))->capture_default_str();
  app->add_option(
         "--coordinators", flags->coordinators,
         "That share the workers, with --jobs jobs each; more than one take LUMIFOLD_STORE=postgresql://...")
      ->check(CLI::Range(1, 16))
      ->capture_default_str();
  app->add_option("--seconds", flags->seconds, "Time of measurement")->capture_default_str();
  app->add_option("--size", flags->size, "Width and height of a frame, in pixels")->capture_default_str();
  app->add_option("--tile", flags->tile, "Tile size in pixels")->capture_default_str();
  app->add_option("--pass-samples", flags->pass_samples, "Samples a pixel of a pass, an even number")
      ->check(CLI::Range(2, 64))
      ->capture_default_str();
  app->add_option(
      "--scene", flags->scene,
      "Send units of this generated scene (cornell-box, meeting-room ...); otherwise made-up values");
  app->add_flag("--float32", flags->float32,
                "Send all planes as float32 instead of their smallest encodings");
  app->add_option("--units", flags->units, "Units to commit before the restart")->capture_default_str();
  app->add_option("--frames", flags->frames, "Of --measure frames")
      ->check(CLI::Range(2, 1'000))
      ->capture_default_str();
  app->add_option("--result-mb", flags->result_mb, "Size of the file of a frame, of --measure frames")
      ->check(CLI::Range(1, 1'000))
      ->capture_default_str();
  app->add_flag("--tls", flags->tls, "With certificates and tokens, instead of plain text");
  app->add_option("--folder", flags->folder, "Where the data folder is made, and removed at the end")
      ->capture_default_str();
  app->add_option("--server", flags->server, "The program of the coordinator")->capture_default_str();
}

void Print(std::string_view name, double value, int digits = 1) {
  std::printf("%-36.*s %.*f\n", static_cast<int>(name.size()), name.data(), digits, value);
  std::fflush(stdout);
}

/// Value at `share` of sorted values; 0 if there are none.
double Quantile(const std::vector<double>& sorted, double share) {
  if (sorted.empty()) return 0;
  return sorted[std::min(sorted.size() - 1, static_cast<size_t>(share * static_cast<double>(sorted.size())))];
}

double OwnCpuSeconds() {
  timespec time = {};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

v1::JobSpec SpecOf(const Flags& flags, const v1::SceneRef& scene) {
  const bool has_frames = flags.measure == "frames" || flags.measure == "kept";
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  *spec.mutable_scene() = scene;
  spec.set_width(flags.size);
  spec.set_height(flags.size);
  spec.set_frame_count(has_frames ? flags.frames : 1);
  spec.set_samples_per_pixel(flags.pass_samples * (has_frames ? 1 : kPasses));
  if (has_frames) spec.set_first_pass_samples(job::kFirstPassSamples);  // as a plan does
  spec.set_pass_samples(flags.pass_samples);
  spec.set_tile_size(flags.tile);
  spec.mutable_filter()->set_method("none");
  return spec;
}

/// A folder that is removed at the end.
class ScratchFolder {
 public:
  explicit ScratchFolder(const std::string& parent)
      : path_(std::filesystem::path(parent) / absl::StrCat("farm-load-", getpid())) {
    std::filesystem::create_directories(path_);
  }
  ~ScratchFolder() {
    std::error_code error;
    std::filesystem::remove_all(path_, error);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  std::string Path(std::string_view name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

/// Bytes per second of a sequential write of `bytes` in pieces of `piece`, with fdatasync as often as the
/// coordinator has it at full load.
double DiskBytesPerSecond(const std::string& path, int64_t bytes, size_t piece) {
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  const std::string data(piece, 'x');
  const absl::Time start = rpc::MonotonicNow();
  size_t dirty = 0;
  for (int64_t written = 0; written < bytes; written += static_cast<int64_t>(piece)) {
    if (write(file, data.data(), data.size()) != static_cast<ssize_t>(data.size())) break;
    dirty += piece;
    if (dirty < kSyncedBytes) continue;
    fdatasync(file);
    dirty = 0;
  }
  fdatasync(file);
  const double seconds = absl::ToDoubleSeconds(rpc::MonotonicNow() - start);
  close(file);
  unlink(path.c_str());
  return static_cast<double>(bytes) / seconds;
}

/// Workers that load coordinators, each one of them, until they are destroyed.
class Load {
 public:
  /// `units`, and `results`, which may be null, must outlive it.
  Load(const std::vector<std::string>& addresses, const rpc::Security& security, int workers, int slots,
       ReadyUnits* units, const ReadyResults* results = nullptr) {
    for (size_t i = 0; i < static_cast<size_t>(workers); ++i)
      workers_.push_back(std::make_unique<LoadWorker>(addresses[i % addresses.size()], security,
                                                      absl::StrCat("load-", i), slots, units, results,
                                                      &counters));
    pulse_ = std::thread([this] {
      while (!stop_.WaitFor(kHeartbeat)) {
        for (const std::unique_ptr<LoadWorker>& worker : workers_) worker->SendHeartbeat();
      }
    });
  }
  ~Load() {
    stop_.Notify();
    pulse_.join();
    for (const std::unique_ptr<LoadWorker>& worker : workers_) worker->Cancel();
  }
  Load(const Load&) = delete;
  Load& operator=(const Load&) = delete;

  bool WaitForWorkers() const {
    return WaitUntil([this] { return counters.welcomed == static_cast<int>(workers_.size()); });
  }
  /// False where they do not arrive, or a stream has ended.
  bool WaitForUnits(int64_t units) const {
    return WaitUntil([this, units] { return counters.committed >= units; });
  }

  bool WaitForKept(int64_t frames) const {
    return WaitUntil([this, frames] { return counters.kept >= frames; });
  }
  /// Until the one job has so many frames, whoever finished them.
  bool WaitForFrames(Client& client, int frames) const {
    constexpr absl::Duration kPause = absl::Milliseconds(100);
    return WaitUntil(
        [&client, frames] {
          const absl::StatusOr<v1::ListJobsResponse> jobs = client.List(/*limit=*/1, "");
          return jobs.ok() && jobs->jobs_size() == 1 && jobs->jobs(0).frames_done() >= frames;
        },
        kPause);
  }

  LoadCounters counters;

 private:
  template <typename Condition>
  bool WaitUntil(Condition condition, absl::Duration pause = absl::Milliseconds(5)) const {
    const absl::Time end = rpc::MonotonicNow() + kPatience;
    while (!condition()) {
      if (counters.ended > 0 || rpc::MonotonicNow() > end) return false;
      absl::SleepFor(pause);
    }
    return true;
  }

  threads::Event stop_;
  std::vector<std::unique_ptr<LoadWorker>> workers_;
  std::thread pulse_;
};

int Fail(const absl::Status& status) {
  std::cerr << "farm-load: " << std::string(status.message()) << '\n';
  return 1;
}

absl::StatusOr<LoadAccess> SetUpAccess(const Flags& flags, const ScratchFolder& folder) {
  return flags.tls ? LoadAccess::SetUp(folder.Path("data"), folder.Path("config")) : LoadAccess();
}

absl::StatusOr<std::unique_ptr<ReadyUnits>> MakeUnits(const Flags& flags) {
  if (flags.scene.empty()) return std::make_unique<ReadyUnits>(flags.float32);
  return ReadyUnits::OfScene(flags.scene, {.size = flags.size,
                                           .tile = flags.tile,
                                           .pass_samples = static_cast<uint32_t>(flags.pass_samples),
                                           .float32 = flags.float32});
}

/// Coordinators over one data folder.
class Servers {
 public:
  absl::Status Start(const Flags& flags, const ScratchFolder& folder) {
    for (int i = 0; i < flags.coordinators; ++i) {
      absl::StatusOr<std::unique_ptr<ServerProcess>> server =
          ServerProcess::Start(flags.server, folder.Path("data"), folder.Path(absl::StrCat("log-", i)));
      if (!server.ok()) return server.status();
      processes_.push_back(*std::move(server));
    }
    return absl::OkStatus();
  }
  std::vector<std::string> addresses() const {
    std::vector<std::string> addresses;
    for (const std::unique_ptr<ServerProcess>& server : processes_) addresses.push_back(server->address());
    return addresses;
  }
  double cpu_seconds() const {
    double seconds = 0;
    for (const std::unique_ptr<ServerProcess>& server : processes_) seconds += server->cpu_seconds();
    return seconds;
  }
  int64_t rss_bytes() const {
    int64_t bytes = 0;
    for (const std::unique_ptr<ServerProcess>& server : processes_) bytes += server->rss_bytes();
    return bytes;
  }
  void Stop() { processes_.clear(); }

 private:
  std::vector<std::unique_ptr<ServerProcess>> processes_;
};

/// Uploads the scene and submits --jobs jobs to one coordinator.
absl::Status SubmitJobs(const Flags& flags, Client& client, const std::string& prefix = "load-") {
  const absl::StatusOr<v1::SceneRef> scene = client.UploadScene();
  if (!scene.ok()) return scene.status();
  for (int i = 0; i < flags.jobs; ++i) {
    if (absl::Status status = client.Submit(SpecOf(flags, *scene), absl::StrCat(prefix, i)).status();
        !status.ok())
      return status;
  }
  return absl::OkStatus();
}

/// Whether the load was undisturbed; prints what disturbed it.
bool IsClean(const Load& load) {
  for (const std::string& error : load.counters.errors()) std::cerr << "farm-load: " << error << '\n';
  return load.counters.errors().empty() && load.counters.refused == 0 && load.counters.ended == 0;
}

/// A state of the load, to be subtracted from a later one.
struct Snapshot {
  Snapshot(const Load& load, const Servers& server)
      : at(rpc::MonotonicNow()),
        units(static_cast<double>(load.counters.committed)),
        bytes(static_cast<double>(load.counters.committed_bytes)),
        server_cpu(server.cpu_seconds()),
        own_cpu(OwnCpuSeconds()) {}
  absl::Time at;
  double units;
  double bytes;
  double server_cpu;
  double own_cpu;
};

void PrintTimes(const char* what, const std::vector<double>& sorted) {
  Print(absl::StrCat(what, "_p50_ms"), Quantile(sorted, 0.5), 3);
  Print(absl::StrCat(what, "_p99_ms"), Quantile(sorted, 0.99), 3);
  Print(absl::StrCat(what, "_max_ms"), Quantile(sorted, 1), 3);
}

/// Prints the servers' memory at ten moments of the load, and returns after `seconds`.
void WatchMemory(const Servers& server, double seconds) {
  constexpr int kMoments = 10;
  for (int i = 0; i < kMoments; ++i) {
    absl::SleepFor(absl::Seconds(seconds / kMoments));
    Print(absl::StrCat("server_rss_mb_at_", (i + 1) * 100 / kMoments, "_percent"),
          static_cast<double>(server.rss_bytes()) / kMega);
  }
}

int MeasureUnits(const Flags& flags) {
  const absl::StatusOr<std::unique_ptr<ReadyUnits>> units_to_send = MakeUnits(flags);
  if (!units_to_send.ok()) return Fail(units_to_send.status());
  const ScratchFolder folder(flags.folder);
  absl::StatusOr<LoadAccess> access = SetUpAccess(flags, folder);
  if (!access.ok()) return Fail(access.status());
  Servers servers;
  if (absl::Status status = servers.Start(flags, folder); !status.ok()) return Fail(status);
  const std::vector<std::string> addresses = servers.addresses();
  if (absl::Status status = access->Join(addresses.front()); !status.ok()) return Fail(status);
  for (const std::string& address : addresses) {
    Client client(address, access->client());
    if (absl::Status status = SubmitJobs(flags, client, absl::StrCat("load-", address, "-")); !status.ok())
      return Fail(status);
  }
  double unit_bytes = 0;
  bool clean = false;
  {
    Load load(addresses, access->worker(), flags.workers, flags.slots, units_to_send->get());
    // The first units of a job are those of the geometry; the passes are measured.
    const int64_t first_units = int64_t{flags.size / flags.tile} * (flags.size / flags.tile) * flags.jobs;
    if (!load.WaitForWorkers() || !load.WaitForUnits(std::min(first_units, int64_t{5000}))) {
      IsClean(load);
      return Fail(absl::UnavailableError("the workers get no leases"));
    }
    load.counters.StartTiming();
    const Snapshot first(load, servers);
    WatchMemory(servers, flags.seconds);
    const Snapshot last(load, servers);
    load.counters.StopTiming();
    clean = IsClean(load) && last.units > first.units;
    const double seconds = absl::ToDoubleSeconds(last.at - first.at);
    const double units = last.units - first.units;
    unit_bytes = (last.bytes - first.bytes) / std::max(1.0, units);
    Print("units_per_second", units / seconds);
    Print("committed_units", last.units, 0);  // since the start
    Print("mb_per_second", (last.bytes - first.bytes) / seconds / kMega);
    Print("bytes_per_unit", unit_bytes, 0);
    Print("server_cpu_seconds_per_1000_units", (last.server_cpu - first.server_cpu) / units * 1000, 4);
    Print("load_cpu_seconds_per_1000_units", (last.own_cpu - first.own_cpu) / units * 1000, 4);
    Print("server_cores", (last.server_cpu - first.server_cpu) / seconds, 2);
    PrintTimes("lease", load.counters.lease_ms());
    PrintTimes("commit", load.counters.commit_ms());
  }
  servers.Stop();
  std::filesystem::remove_all(folder.Path("data"));
  const auto piece = static_cast<size_t>(unit_bytes);
  const int64_t bytes = std::min(int64_t{2} << 30, static_cast<int64_t>(unit_bytes * 500 * flags.seconds));
  if (piece > 0) Print("disk_mb_per_second", DiskBytesPerSecond(folder.Path("disk"), bytes, piece) / kMega);
  return clean ? 0 : 1;
}

/// Holds the coordinator's one place for frames, so that workers get nearly all the others: stops the first
/// child that it finds, until its destruction.
class HeldPlace {
 public:
  explicit HeldPlace(const ServerProcess* server) : server_(server), watch_([this] { Watch(); }) {}
  ~HeldPlace() {
    stop_.Notify();
    watch_.join();
    server_->SignalChildren(SIGCONT);
  }
  HeldPlace(const HeldPlace&) = delete;
  HeldPlace& operator=(const HeldPlace&) = delete;

 private:
  void Watch() const {
    constexpr absl::Duration kPause = absl::Milliseconds(2);
    while (server_->SignalChildren(SIGSTOP) == 0 && !stop_.WaitFor(kPause)) {
    }
  }

  const ServerProcess* const server_;
  threads::Event stop_;
  std::thread watch_;  // last member: it uses the members above
};

/// First all units are delivered, then the frames are finished.
int MeasureFrames(const Flags& flags) {
  const absl::StatusOr<std::unique_ptr<ReadyUnits>> units = MakeUnits(flags);
  if (!units.ok()) return Fail(units.status());
  ReadyResults results(static_cast<size_t>(flags.result_mb) << 20);
  const ScratchFolder folder(flags.folder);
  const absl::StatusOr<std::unique_ptr<ServerProcess>> server = ServerProcess::Start(
      flags.server, folder.Path("data"), folder.Path("log"), {"--finish-processes", "1"});
  if (!server.ok()) return Fail(server.status());
  const HeldPlace held(server->get());
  Client client((*server)->address(), {});
  if (absl::Status status = SubmitJobs(flags, client); !status.ok()) return Fail(status);
  const int64_t units_of_frame = job::FrameUnits(SpecOf(flags, {})).count();
  const double first_cpu = (*server)->cpu_seconds();
  Load load({(*server)->address()}, {}, flags.workers, flags.slots, units->get(), &results);
  const bool has_units = load.WaitForUnits(units_of_frame * flags.frames);
  const double units_cpu = (*server)->cpu_seconds();
  results.Begin();
  const bool has_frames = has_units && load.WaitForFrames(client, flags.frames - 1);
  const double frames_cpu = (*server)->cpu_seconds();
  const int64_t finished = load.counters.finished;
  if (!IsClean(load) || !has_frames || finished == 0)
    return Fail(absl::UnavailableError("the workers do not finish the frames"));
  Print("units_per_frame", static_cast<double>(units_of_frame), 0);
  Print("mb_per_frame", static_cast<double>(load.counters.committed_bytes) / flags.frames / kMega);
  Print("server_cpu_seconds_per_frame_received", (units_cpu - first_cpu) / flags.frames, 4);
  Print("server_cpu_seconds_per_frame_finished", (frames_cpu - units_cpu) / static_cast<double>(finished), 4);
  return 0;
}

/// Of --frames frames the first are received, until one is kept; from then on so many are kept as are not left
/// for the end, which all workers share.
int MeasureKept(const Flags& flags) {
  const absl::StatusOr<std::unique_ptr<ReadyUnits>> units = MakeUnits(flags);
  if (!units.ok()) return Fail(units.status());
  ReadyResults results(static_cast<size_t>(flags.result_mb) << 20);
  const ScratchFolder folder(flags.folder);
  const absl::StatusOr<std::unique_ptr<ServerProcess>> server =
      ServerProcess::Start(flags.server, folder.Path("data"), folder.Path("log"),
                           {"--finish-processes", "1", "--keep-film-gb", "0"});
  if (!server.ok()) return Fail(server.status());
  const HeldPlace held(server->get());
  Client client((*server)->address(), {});
  if (absl::Status status = SubmitJobs(flags, client); !status.ok()) return Fail(status);
  Load load({(*server)->address()}, {}, flags.workers, flags.slots, units->get(), &results);
  const int64_t measured = flags.frames - 5 * int64_t{flags.workers};
  const bool has_first = load.WaitForKept(flags.workers);
  const double first_cpu = (*server)->cpu_seconds();
  const int64_t first = load.counters.kept;
  const bool has_all = has_first && load.WaitForKept(first + measured);
  const double all_cpu = (*server)->cpu_seconds();
  const int64_t kept = load.counters.kept - first;
  results.Begin();
  if (!IsClean(load) || !has_all || kept <= 0)
    return Fail(absl::UnavailableError("the workers do not keep frames"));
  Print("frames_kept", static_cast<double>(kept), 0);
  Print("server_cpu_seconds_per_frame_kept", (all_cpu - first_cpu) / static_cast<double>(kept), 4);
  return 0;
}

int MeasureRestart(const Flags& flags) {
  const absl::StatusOr<std::unique_ptr<ReadyUnits>> units = MakeUnits(flags);
  if (!units.ok()) return Fail(units.status());
  const ScratchFolder folder(flags.folder);
  absl::StatusOr<LoadAccess> access = SetUpAccess(flags, folder);
  if (!access.ok()) return Fail(access.status());
  absl::StatusOr<std::unique_ptr<ServerProcess>> server =
      ServerProcess::Start(flags.server, folder.Path("data"), folder.Path("log"));
  if (!server.ok()) return Fail(server.status());
  if (absl::Status status = access->Join((*server)->address()); !status.ok()) return Fail(status);
  {
    Client client((*server)->address(), access->client());
    if (absl::Status status = SubmitJobs(flags, client); !status.ok()) return Fail(status);
    Load load({(*server)->address()}, access->worker(), flags.workers, flags.slots, units->get());
    if (!load.WaitForUnits(flags.units) || !IsClean(load))
      return Fail(absl::UnavailableError("the units are not committed"));
    Print("committed_units", static_cast<double>(load.counters.committed), 0);
    (*server)->Kill();
  }
  const absl::Time start = rpc::MonotonicNow();
  server = ServerProcess::Start(flags.server, folder.Path("data"), folder.Path("log"));
  if (!server.ok()) return Fail(server.status());
  Print("restart_seconds", absl::ToDoubleSeconds(rpc::MonotonicNow() - start), 3);
  Load load({(*server)->address()}, access->worker(), flags.workers, flags.slots, units->get());
  if (!load.WaitForUnits(1) || !IsClean(load)) return Fail(absl::UnavailableError("the job does not go on"));
  Print("first_commit_seconds", absl::ToDoubleSeconds(rpc::MonotonicNow() - start), 3);
  return 0;
}

/// Submits the jobs on several connections; all but a hundred are cancelled, as most jobs of a store have
/// ended.
absl::Status FillStore(const Flags& flags, const std::string& address, const rpc::Security& security,
                       const v1::SceneRef& scene) {
  constexpr int kThreads = 32;
  constexpr int kActive = 100;
  std::vector<std::thread> threads;
  threads.reserve(kThreads);
  std::vector<absl::Status> results(kThreads);
  for (int thread = 0; thread < kThreads; ++thread) {
    threads.emplace_back([&, thread] {
      Client client(address, security);
      for (int i = thread; i < flags.jobs; i += kThreads) {
        const absl::StatusOr<std::string> job = client.Submit(SpecOf(flags, scene), absl::StrCat("list-", i));
        results[thread] = !job.ok() ? job.status() : i < kActive ? absl::OkStatus() : client.Cancel(*job);
        if (!results[thread].ok()) return;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const absl::Status& status : results) {
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

int MeasureList(const Flags& flags) {
  constexpr int kLimit = 100;
  const ScratchFolder folder(flags.folder);
  absl::StatusOr<LoadAccess> access = SetUpAccess(flags, folder);
  if (!access.ok()) return Fail(access.status());
  const absl::StatusOr<std::unique_ptr<ServerProcess>> server =
      ServerProcess::Start(flags.server, folder.Path("data"), folder.Path("log"));
  if (!server.ok()) return Fail(server.status());
  if (absl::Status status = access->Join((*server)->address()); !status.ok()) return Fail(status);
  Client client((*server)->address(), access->client());
  const absl::StatusOr<v1::SceneRef> scene = client.UploadScene();
  if (!scene.ok()) return Fail(scene.status());
  const absl::Time start = rpc::MonotonicNow();
  if (absl::Status status = FillStore(flags, (*server)->address(), access->client(), *scene); !status.ok())
    return Fail(status);
  Print("jobs_per_second", flags.jobs / absl::ToDoubleSeconds(rpc::MonotonicNow() - start));
  Print("server_rss_mb", static_cast<double>((*server)->rss_bytes()) / kMega);
  std::vector<double> ms;
  int64_t listed = 0;
  std::string page;
  do {
    const absl::Time before = rpc::MonotonicNow();
    const absl::StatusOr<v1::ListJobsResponse> jobs = client.List(kLimit, page);
    if (!jobs.ok()) return Fail(jobs.status());
    ms.push_back(absl::ToDoubleMilliseconds(rpc::MonotonicNow() - before));
    listed += jobs->jobs_size();
    page = jobs->next_page_token();
  } while (!page.empty());
  Print("first_page_ms", ms.front(), 3);
  std::sort(ms.begin(), ms.end());
  PrintTimes("page", ms);
  Print("listed_jobs", static_cast<double>(listed), 0);
  return listed == flags.jobs ? 0 : 1;
}

/// A worker is a socket here and one in the coordinator.
void RaiseDescriptorLimit() {
  rlimit limit = {};
  getrlimit(RLIMIT_NOFILE, &limit);
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_NOFILE, &limit);
}

int Run(const Flags& flags) {
  RaiseDescriptorLimit();
  if (flags.measure == "frames") return MeasureFrames(flags);
  if (flags.measure == "kept") return MeasureKept(flags);
  if (flags.measure == "restart") return MeasureRestart(flags);
  if (flags.measure == "list") return MeasureList(flags);
  return MeasureUnits(flags);
}

}  // namespace
}  // namespace lumifold::bench

int main(int argc, char** argv) {
  setenv("GRPC_VERBOSITY", "NONE", /*overwrite=*/0);
  CLI::App app("Loads a coordinator with workers that do not render, and measures it.", "farm-load");
  lumifold::bench::Flags flags;
  lumifold::bench::AddFlags(&app, &flags);
  CLI11_PARSE(app, argc, argv);
  return lumifold::bench::Run(flags);
}
