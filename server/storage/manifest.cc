#include "server/storage/manifest.h"

#include "absl/strings/str_cat.h"
#include "filter/image/file_io.h"
#include "proto/rpc/checked_file.h"
#include "proto/rpc/limits.h"

namespace lumifold::server {
namespace {

/// A serialised v1::JobManifest. A spec fits a message, and so does the rest of a manifest.
constexpr rpc::CheckedFileType kManifestFile = {"LFM1", "the manifest", 2 * int64_t{rpc::kMaxMessageBytes}};
constexpr int64_t kMaxClassBytes = rpc::kMaxWorkerNameBytes;

absl::Status WriteTo(const DataFolder& folder, const std::string& path, const v1::JobManifest& manifest) {
  return rpc::WriteCheckedFile(path, kManifestFile, manifest.SerializeAsString(), folder.files());
}

}  // namespace

v1::JobManifest ManifestOf(const ledger::NewJob& job) {
  v1::JobManifest manifest;
  manifest.set_job_id(job.id.value());
  manifest.set_request_id(job.request_id);
  *manifest.mutable_spec() = job.spec;
  *manifest.mutable_scheduling() = job.scheduling;
  manifest.set_submitted_unix_ms(absl::ToUnixMillis(job.submitted));
  return manifest;
}

ledger::NewJob JobOf(const v1::JobManifest& manifest, const ledger::Owner& owner) {
  return {.id = job::JobId(manifest.job_id()),
          .request_id = manifest.request_id(),
          .spec = manifest.spec(),
          .scheduling = manifest.scheduling(),
          .submitted = absl::FromUnixMillis(manifest.submitted_unix_ms()),
          .owner = owner};
}

absl::Status WriteManifest(const DataFolder& folder, const v1::JobManifest& manifest) {
  const job::JobId job(manifest.job_id());
  if (absl::Status status = MakeFolder(folder.FilmPath(job), folder.files()); !status.ok()) return status;
  return WriteTo(folder, folder.ManifestPath(job), manifest);
}

absl::Status RewriteManifest(const DataFolder& folder, const job::JobId& job,
                             const v1::Scheduling& scheduling) {
  absl::StatusOr<v1::JobManifest> manifest = ReadManifest(folder.ManifestPath(job));
  if (!manifest.ok()) return manifest.status();
  *manifest->mutable_scheduling() = scheduling;
  return WriteTo(folder, folder.ManifestPath(job), *manifest);
}

absl::Status RewriteManifest(const DataFolder& folder, const job::JobId& job, const v1::JobSpec& spec) {
  absl::StatusOr<v1::JobManifest> manifest = ReadManifest(folder.ManifestPath(job));
  if (!manifest.ok()) return manifest.status();
  *manifest->mutable_spec() = spec;
  return WriteTo(folder, folder.ManifestPath(job), *manifest);
}

absl::Status RetireJob(const DataFolder& folder, const job::JobId& job, v1::JobState end_state,
                       const std::string& error) {
  absl::StatusOr<v1::JobManifest> manifest = ReadManifest(folder.ManifestPath(job));
  if (manifest.ok()) {
    manifest->set_end_state(end_state);
    manifest->set_error(error);
    if (absl::Status status = MakeFolder(folder.ResultsPath(job), folder.files()); !status.ok())
      return status;
    if (absl::Status status = WriteTo(folder, folder.EndedManifestPath(job), *manifest); !status.ok())
      return status;
  } else if (absl::IsUnavailable(manifest.status())) {
    return manifest.status();
  }
  return RemoveAll(folder.ManifestPath(job), folder.files());
}

absl::Status UnretireJob(const DataFolder& folder, const ledger::JobRecord& record) {
  absl::StatusOr<v1::JobManifest> manifest = ReadManifest(folder.ManifestPath(record.id));
  if (absl::IsNotFound(manifest.status())) manifest = ReadManifest(folder.EndedManifestPath(record.id));
  if (absl::IsUnavailable(manifest.status())) return manifest.status();
  if (!manifest.ok()) {  // damaged, or of a version without manifests
    manifest = ManifestOf({.id = record.id,
                           .request_id = absl::StrCat("of ", record.id.value()),
                           .spec = record.spec,
                           .scheduling = record.scheduling,
                           .submitted = record.submitted,
                           .owner = record.owner});
  }
  *manifest->mutable_spec() = record.spec;
  *manifest->mutable_scheduling() = record.scheduling;
  manifest->clear_end_state();
  manifest->clear_error();
  if (absl::Status status = WriteManifest(folder, *manifest); !status.ok()) return status;
  return RemoveAll(folder.EndedManifestPath(record.id), folder.files());
}

absl::StatusOr<v1::JobManifest> ReadManifest(const std::string& path) {
  const absl::StatusOr<std::string> bytes = rpc::ReadCheckedFile(path, kManifestFile);
  if (!bytes.ok()) return bytes.status();
  v1::JobManifest manifest;
  if (!manifest.ParseFromString(*bytes))
    return absl::DataLossError(absl::StrCat(path, ": the manifest is damaged"));
  return manifest;
}

absl::Status WriteNumericClass(const DataFolder& folder, const job::JobId& job,
                               const std::string& numeric_class) {
  return WriteFileAtomically(folder.NumericClassPath(job), numeric_class, folder.files());
}

std::string ReadNumericClass(const DataFolder& folder, const job::JobId& job) {
  return ReadFile(folder.NumericClassPath(job), kMaxClassBytes).value_or("");
}

}  // namespace lumifold::server
