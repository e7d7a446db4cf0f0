#pragma once

#include <grpcpp/grpcpp.h>

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "lumifold/v1/farm.grpc.pb.h"

namespace lumifold::client {

/// A fake coordinator behind a real socket: it records requests and sends the answers set by the test.
class FakeFarm final : public v1::FarmService::Service {
 public:
  FakeFarm();
  ~FakeFarm() override;

  /// HOST:PORT it listens on.
  const std::string& address() const { return address_; }
  std::shared_ptr<grpc::Channel> channel() const;

  // Answers; set before the calls.
  std::vector<v1::JobStatus> watched;  // sent one by one; then the stream ends
  size_t watched_per_stream = 1000;    // breaks the stream after this number of statuses
  grpc::StatusCode broken_watch = grpc::StatusCode::UNAVAILABLE;
  bool hold_watch = false;                    // keeps the stream open until the client disconnects
  std::string result;                         // the file of every frame
  std::vector<uint64_t> break_downloads;      // the n-th download breaks at this offset of the file
  std::vector<std::string> sent_results;      // the n-th download sends this file instead, with its checksums
  std::string stated_sha256;                  // instead of that of `result`
  std::vector<uint64_t> break_uploads;        // the n-th upload breaks when the farm has this number of bytes
  std::string submit_error;                   // INVALID_ARGUMENT with this text
  std::map<std::string, v1::JobStatus> jobs;  // all that ListJobs lists, in pages of at most `page_jobs`
  int page_jobs = 1000;
  std::vector<v1::WorkerStatus> workers;  // ListWorkers lists one on a page
  std::vector<v1::Reason> reasons;
  std::vector<v1::LogEvent> events;
  v1::ServerStatus server_status;
  v1::Preview preview;  // then the job ends without the frame

  /// What the farm has from an upload that broke.
  void KeepUpload(const std::string& sha256, const std::string& content);

  // Recorded requests.
  std::vector<std::string> uploads() const;  // contents, in order
  std::vector<uint64_t> upload_offsets() const;
  std::vector<v1::SubmitJobRequest> submissions() const;
  std::vector<uint64_t> download_offsets() const;
  std::vector<std::string> cancelled() const;
  /// Calls that change a job or a worker, and those that list: "PauseJob job_id: \"job-1\"".
  std::vector<std::string> calls() const;

 private:
  /// Records the call; the answer is the job of the request, if there is one.
  grpc::Status Record(const std::string& call, const google::protobuf::Message& request);
  template <typename Request>
  grpc::Status ChangeJob(const std::string& call, const Request& request, v1::JobStatus* job);
  grpc::Status ChangeWorker(const std::string& call, const v1::WorkerRequest& request, v1::WorkerState state,
                            v1::WorkerStatus* worker);
  grpc::Status FindMissingAssets(grpc::ServerContext*, const v1::FindMissingAssetsRequest*,
                                 v1::FindMissingAssetsResponse*) override;
  grpc::Status FindUpload(grpc::ServerContext*, const v1::FindUploadRequest*,
                          v1::FindUploadResponse*) override;
  grpc::Status UploadAsset(grpc::ServerContext*, grpc::ServerReader<v1::UploadAssetRequest>*,
                           v1::UploadAssetResponse*) override;
  grpc::Status SubmitJob(grpc::ServerContext*, const v1::SubmitJobRequest*, v1::SubmitJobResponse*) override;
  grpc::Status GetJob(grpc::ServerContext*, const v1::GetJobRequest*, v1::JobStatus*) override;
  grpc::Status ListJobs(grpc::ServerContext*, const v1::ListJobsRequest*, v1::ListJobsResponse*) override;
  grpc::Status WatchJob(grpc::ServerContext*, const v1::WatchJobRequest*,
                        grpc::ServerWriter<v1::JobStatus>*) override;
  grpc::Status CancelJob(grpc::ServerContext*, const v1::CancelJobRequest*, v1::JobStatus*) override;
  grpc::Status PauseJob(grpc::ServerContext*, const v1::PauseJobRequest*, v1::JobStatus*) override;
  grpc::Status ResumeJob(grpc::ServerContext*, const v1::ResumeJobRequest*, v1::JobStatus*) override;
  grpc::Status SetJobPriority(grpc::ServerContext*, const v1::SetJobPriorityRequest*,
                              v1::JobStatus*) override;
  grpc::Status DeleteJob(grpc::ServerContext*, const v1::DeleteJobRequest*, v1::DeleteJobResponse*) override;
  grpc::Status RetryJob(grpc::ServerContext*, const v1::RetryJobRequest*, v1::JobStatus*) override;
  grpc::Status AddSamples(grpc::ServerContext*, const v1::AddSamplesRequest*, v1::JobStatus*) override;
  grpc::Status ExplainJob(grpc::ServerContext*, const v1::ExplainJobRequest*,
                          v1::ExplainJobResponse*) override;
  grpc::Status ListWorkers(grpc::ServerContext*, const v1::ListWorkersRequest*,
                           v1::ListWorkersResponse*) override;
  grpc::Status DrainWorker(grpc::ServerContext*, const v1::WorkerRequest*, v1::WorkerStatus*) override;
  grpc::Status BlockWorker(grpc::ServerContext*, const v1::WorkerRequest*, v1::WorkerStatus*) override;
  grpc::Status ReadmitWorker(grpc::ServerContext*, const v1::WorkerRequest*, v1::WorkerStatus*) override;
  grpc::Status GetLog(grpc::ServerContext*, const v1::GetLogRequest*, v1::GetLogResponse*) override;
  grpc::Status GetUsage(grpc::ServerContext*, const v1::GetUsageRequest*, v1::GetUsageResponse*) override;
  grpc::Status GetServerStatus(grpc::ServerContext*, const v1::GetServerStatusRequest*,
                               v1::ServerStatus*) override;
  grpc::Status GetPreview(grpc::ServerContext*, const v1::GetPreviewRequest*, v1::Preview*) override;
  grpc::Status DownloadResult(grpc::ServerContext*, const v1::DownloadResultRequest*,
                              grpc::ServerWriter<v1::ByteChunk>*) override;

  mutable std::mutex mutex_;
  std::map<std::string, std::string> assets_;  // content by SHA-256
  std::map<std::string, std::string> kept_;    // of uploads that broke, by SHA-256
  std::vector<uint64_t> upload_offsets_;
  std::vector<std::string> uploads_;
  std::vector<v1::SubmitJobRequest> submissions_;
  std::vector<uint64_t> download_offsets_;
  std::vector<std::string> cancelled_;
  std::vector<std::string> calls_;
  size_t next_watched_ = 0;

  std::string address_;
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace lumifold::client
