#include "server/storage/janitor.h"

#include <fcntl.h>
#include <spdlog/logger.h>

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "filter/image/file_system.h"
#include "proto/logging/fields.h"
#include "proto/rpc/byte_stream.h"
#include "server/job/job_spec.h"
#include "server/storage/folder_contents.h"
#include "server/storage/manifest.h"

namespace lumifold::server {
namespace {

namespace fs = std::filesystem;
using job::JobId;

/// Time between two sweeps: how much the rest of the folder uses, uploads and assets that nobody needs.
constexpr absl::Duration kSweepInterval = absl::Seconds(20);
/// Time without removals after one that failed.
constexpr absl::Duration kRetryPause = absl::Seconds(10);
/// Jobs of a page of the ledger.
constexpr int kPageSize = 1000;

uint64_t BytesIn(const std::string& folder) {
  uint64_t bytes = 0;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    std::error_code gone;
    const auto size = entry->is_regular_file(gone) ? entry->file_size(gone) : 0;
    if (!gone) bytes += size;
  }
  return bytes;
}

/// Time of the last write in terms of the wall clock; InfinitePast where there is no file.
absl::Time WrittenAt(const std::string& file) {
  std::error_code error;
  const fs::file_time_type written = fs::last_write_time(file, error);
  return error ? absl::InfinitePast() : absl::FromChrono(fs::file_time_type::clock::to_sys(written));
}

/// Creates an empty file whose name survives a crash.
absl::Status CreateDurably(const std::string& path, FileSystem* files) {
  const rpc::FileHandle file(files->Open(path, O_WRONLY | O_CREAT));
  if (file.get() < 0) return StorageError(path, file.get());
  const int synced = files->SyncFolder(FolderOf(path));
  return synced < 0 ? StorageError(path, synced) : absl::OkStatus();
}

}  // namespace

Janitor::Janitor(JanitorOptions options, const DataFolder& folder, ledger::JobStore* store,
                 AssetStore* assets, threads::TaskThread* thread, threads::TaskThread* deleter)
    : options_(std::move(options)),
      folder_(folder),
      store_(store),
      assets_(assets),
      thread_(thread),
      deleter_(deleter),
      retention_(options_.limits),
      // Without a quota nothing is urgent at the start.
      next_sweep_(options_.limits.quota_bytes.has_value() ? absl::InfinitePast()
                                                          : options_.now() + kSweepInterval) {}

void Janitor::Start() {
  thread_->Run([this] {
    FindDeletions();
    FindEndedJobs();
    Poke();
  });
}

void Janitor::Poke() {
  {
    absl::MutexLock lock(&mutex_);
    if (is_working_) return;
    is_working_ = true;
  }
  thread_->Run([this] { Step(); });
}

void Janitor::Queue(Work work) {
  {
    absl::MutexLock lock(&mutex_);
    queue_.push_back(std::move(work));
  }
  Poke();
}

void Janitor::JobEnded(const JobId& job, v1::JobState state, const std::string& error) {
  Queue(EndedJob{job, state, error});
}

void Janitor::FrameFinished(const JobId& job, int32_t frame) { Queue(FinishedFrame{job, frame}); }

void Janitor::Keep(const JobId& job) {
  absl::MutexLock lock(&mutex_);
  std::erase_if(queue_, [&job](const Work& work) {
    const auto* ended = std::get_if<EndedJob>(&work);
    const auto* finished = std::get_if<FinishedFrame>(&work);
    return (ended != nullptr && ended->job == job) || (finished != nullptr && finished->job == job);
  });
  while (current_ == job) step_done_.Wait(&mutex_);
  retention_.Forget(job);
}

void Janitor::SetNeeded(std::set<JobId> jobs) {
  absl::MutexLock lock(&mutex_);
  retention_.SetNeeded(std::move(jobs));
}

absl::Status Janitor::Delete(const JobId& job) {
  Keep(job);
  absl::Status status = BeginDeletion(job);
  if (status.ok()) Queue(CompleteDeletion{job});
  return status;
}

absl::Status Janitor::BeginDeletion(const JobId& job) {
  // First, because ids that clients send may be any text, and the record is a file of that name.
  if (absl::Status known = store_->GetJob(job).status(); absl::IsNotFound(known)) return known;
  const std::string record = folder_.DeletionPath(job);
  if (absl::Status status = CreateDurably(record, folder_.files()); !status.ok()) return status;
  absl::Status status = store_->DeleteJob(job);
  // It has not ended: there is no deletion to complete. kUnavailable may have deleted it, and the next sweep
  // looks.
  if (absl::IsFailedPrecondition(status)) folder_.files()->Remove(record);
  return status;
}

absl::Status Janitor::CheckQuota() const {
  absl::MutexLock lock(&mutex_);
  if (!options_.limits.quota_bytes.has_value() || other_bytes_ < *options_.limits.quota_bytes)
    return absl::OkStatus();
  return absl::ResourceExhaustedError(absl::StrCat("the quota of ", *options_.limits.quota_bytes,
                                                   " bytes is used up: assets, uploads and active jobs use ",
                                                   other_bytes_, ", and nothing else is left to remove"));
}

uint64_t Janitor::Room() const {
  const uint64_t on_disk = options_.disk().room();
  if (!options_.limits.quota_bytes.has_value()) return on_disk;
  absl::MutexLock lock(&mutex_);
  const uint64_t quota = *options_.limits.quota_bytes;
  return std::min(on_disk, quota > other_bytes_ ? quota - other_bytes_ : 0);
}

void Janitor::Step() {
  const DiskSpace disk = options_.disk();
  std::optional<Work> work;
  {
    absl::MutexLock lock(&mutex_);
    work = FindWork(disk);
    is_working_ = work.has_value();
    if (!work.has_value()) return;
    if (const auto* removal = std::get_if<Removal>(&*work)) current_ = removal->job;
    if (const auto* ended = std::get_if<EndedJob>(&*work)) current_ = ended->job;
    if (const auto* finished = std::get_if<FinishedFrame>(&*work)) current_ = finished->job;
  }
  const Files files = std::visit([this](const auto& item) { return Do(item); }, *work);
  if (!files.ok() || files->empty()) return Finish(*work, files.status());
  deleter_->Run([this, work = *std::move(work), files = *files] {
    absl::Status status;
    for (const std::string& path : files) {
      if (status.ok()) status = RemoveAll(path, folder_.files());
    }
    thread_->Run([this, work, status] { Finish(work, status); });
  });
}

void Janitor::Finish(const Work& work, const absl::Status& status) {
  if (!status.ok())
    options_.log->warn("event=not_deleted error={}", logging::Quoted(std::string(status.message())));
  {
    absl::MutexLock lock(&mutex_);
    if (!status.ok()) not_before_ = options_.now() + kRetryPause;
    if (const auto* removal = std::get_if<Removal>(&work); removal != nullptr && status.ok()) Count(*removal);
    current_.reset();
    is_working_ = false;
    step_done_.SignalAll();
  }
  Poke();
}

void Janitor::Count(const Removal& removal) {
  const std::string cause = logging::Quoted(removal.cause);
  switch (removal.what) {
    case Removal::What::kJob:
      options_.log->info("event=job_deleted job={} cause={}", removal.job.value(), cause);
      retention_.Forget(removal.job);
      queue_.emplace_back(CompleteDeletion{removal.job});
      break;
    case Removal::What::kFilm:
      options_.log->info("event=film_removed job={} cause={}", removal.job.value(), cause);
      retention_.FilmRemoved(removal.job);
      break;
    case Removal::What::kFrame:
      options_.log->info("event=film_removed job={} frame={} cause={}", removal.job.value(), removal.frame,
                         cause);
      retention_.FrameRemoved(removal.job, removal.frame);
  }
}

std::optional<Janitor::Work> Janitor::FindWork(const DiskSpace& disk) {
  if (!queue_.empty()) {
    Work work = std::move(queue_.front());
    queue_.pop_front();
    return work;
  }
  const absl::Time now = options_.now();
  if (now >= next_sweep_) {
    next_sweep_ = now + kSweepInterval;
    return Sweep{};
  }
  if (now < not_before_) return std::nullopt;
  std::optional<Removal> removal = retention_.Next(options_.wall_now(), disk.free_bytes);
  if (!removal.has_value()) return std::nullopt;
  return *std::move(removal);
}

Janitor::Files Janitor::Do(const EndedJob& ended) {
  const absl::Status retired = RetireJob(folder_, ended.job, ended.state, ended.error);
  if (!retired.ok()) {  // the next start tries again
    options_.log->warn("event=not_retired job={} error={}", ended.job.value(),
                       logging::Quoted(std::string(retired.message())));
  }
  absl::Time end = WrittenAt(folder_.EndedManifestPath(ended.job));
  if (end == absl::InfinitePast())
    end = WrittenAt(folder_.ResultsPath(ended.job));           // of a version without manifests
  if (end == absl::InfinitePast()) end = options_.wall_now();  // without results
  const uint64_t film = BytesIn(folder_.FilmPath(ended.job));
  if (film == 0) RemoveAll(folder_.FilmPath(ended.job), folder_.files()).IgnoreError();  // an empty folder
  const uint64_t results = BytesIn(folder_.ResultsPath(ended.job));
  absl::MutexLock lock(&mutex_);
  retention_.JobEnded(ended.job, end, film, results);
  return std::vector<std::string>();
}

Janitor::Files Janitor::Do(const FinishedFrame& finished) {
  const std::vector<UnitLogFile> logs = UnitLogsOf(folder_, finished.job, finished.frame);
  if (logs.empty()) return std::vector<std::string>();
  absl::Time written = absl::InfinitePast();
  uint64_t bytes = 0;
  for (const UnitLogFile& log : logs) {
    written = std::max(written, WrittenAt(folder_.PathOf(log.name)));
    bytes += log.bytes;
  }
  absl::MutexLock lock(&mutex_);
  retention_.FrameFinished(finished.job, finished.frame, written, bytes);
  return std::vector<std::string>();
}

Janitor::Files Janitor::Do(const Removal& removal) {
  std::vector<std::string> files;
  switch (removal.what) {
    case Removal::What::kFilm:
      files.push_back(folder_.FilmPath(removal.job));
      break;
    case Removal::What::kFrame:
      for (const UnitLogFile& log : UnitLogsOf(folder_, removal.job, removal.frame))
        files.push_back(folder_.PathOf(log.name));
      break;
    case Removal::What::kJob:
      const absl::Status deleted = BeginDeletion(removal.job);
      if (!deleted.ok() && !absl::IsNotFound(deleted)) return deleted;
  }
  return files;
}

Janitor::Files Janitor::Do(const CompleteDeletion& deletion) {
  const JobId& job = deletion.job;
  // The record may be older than the end of the row: a crash came between, or the ledger could not be
  // reached.
  const absl::Status row = store_->DeleteJob(job);
  const std::string record = folder_.DeletionPath(job);
  if (absl::IsFailedPrecondition(row)) return std::vector{record};  // it runs: there is nothing to complete
  if (!row.ok() && !absl::IsNotFound(row)) return row;
  return std::vector{folder_.FilmPath(job), folder_.ResultsPath(job), record};
}

Janitor::Files Janitor::Do(const Sweep&) {
  assets_->RemoveOldUploads();
  const absl::Status assets = assets_->RemoveUnused([this] { return ReferencedAssets(); });
  FindDeletions();
  if (options_.limits.quota_bytes.has_value()) {
    uint64_t all = 0;
    for (const char* folder : {"/assets", "/incoming", "/film", "/results"})
      all += BytesIn(folder_.root() + folder);
    absl::MutexLock lock(&mutex_);
    const uint64_t removable = retention_.used_bytes() - other_bytes_;
    other_bytes_ = all > removable ? all - removable : 0;
    retention_.SetOtherBytes(other_bytes_);
  }
  if (!assets.ok()) return assets;
  return std::vector<std::string>();
}

void Janitor::FindDeletions() {
  std::error_code error;
  for (fs::directory_iterator entry(folder_.DeletionsPath(), error), end; !error && entry != end;
       entry.increment(error)) {
    absl::MutexLock lock(&mutex_);
    queue_.emplace_back(CompleteDeletion{JobId(entry->path().filename().string())});
  }
}

void Janitor::FindEndedJobs() {
  ledger::JobFilter filter;
  filter.limit = kPageSize;
  filter.states = {v1::JOB_STATE_DONE, v1::JOB_STATE_DONE_WITH_GAPS, v1::JOB_STATE_FAILED,
                   v1::JOB_STATE_CANCELLED};
  while (true) {
    const absl::StatusOr<ledger::JobPage> page = store_->ListJobs(filter);
    if (!page.ok()) return;  // films stay until the next start
    for (const ledger::JobRecord& job : page->jobs) {
      absl::MutexLock lock(&mutex_);
      queue_.emplace_back(EndedJob{job.id, job.state, job.error});
    }
    if (!page->next.has_value()) return;
    filter.before = page->next;
  }
}

absl::StatusOr<std::set<std::string>> Janitor::ReferencedAssets() {
  std::set<std::string> assets;
  ledger::JobFilter filter;
  filter.limit = kPageSize;
  while (true) {
    const absl::StatusOr<ledger::JobPage> page = store_->ListJobs(filter);
    if (!page.ok()) return page.status();
    if (!page->damaged.empty()) return page->damaged.front().error;  // nobody knows what it refers to
    for (const ledger::JobRecord& listed : page->jobs) {
      const absl::StatusOr<ledger::JobRecord> job = store_->GetJob(listed.id);  // with all files of its scene
      if (absl::IsNotFound(job.status())) continue;
      if (!job.ok()) return job.status();
      assets.merge(job::FilesOf(job->spec.scene()));
    }
    if (!page->next.has_value()) return assets;
    filter.before = page->next;
  }
}

}  // namespace lumifold::server
