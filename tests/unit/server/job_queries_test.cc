// What a coordinator answers about its jobs, without a socket.
#include "server/coordinator/job_queries.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "server/coordinator/event_log.h"
#include "server/preview/make_preview.h"
#include "tests/unit/server/coordinator_fixture.h"

namespace lumifold::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class JobQueriesTest : public CoordinatorFixture {
 protected:
  JobQueriesTest() { options_.job_log.events = &events_; }
  ~JobQueriesTest() override { Stop(); }

  JobApi& queries() { return coordinator_->jobs(); }
  job::JobId SubmitFor(const std::string& user, const std::string& name, const v1::JobSpec& spec) {
    scheduling_.set_user(user);
    scheduling_.set_name(name);
    return Submit(spec, name);
  }
  /// The names of the jobs of all pages, each of at most `limit`.
  std::vector<std::string> Names(v1::ListJobsRequest request, int limit) {
    std::vector<std::string> names;
    request.set_limit(limit);
    do {
      const absl::StatusOr<v1::ListJobsResponse> page = queries().ListJobs(request);
      EXPECT_TRUE(page.ok()) << page.status();
      if (!page.ok()) break;
      EXPECT_LE(page->jobs_size(), limit);
      for (const v1::JobStatus& job : page->jobs()) names.push_back(job.display_name());
      request.set_page_token(page->next_page_token());
    } while (!request.page_token().empty());
    return names;
  }
  static v1::ListJobsRequest Of(const std::vector<v1::JobState>& states, const std::string& user = "") {
    v1::ListJobsRequest request;
    for (const v1::JobState state : states) request.add_states(state);
    request.set_user(user);
    return request;
  }

  EventLog events_;
};

TEST_F(JobQueriesTest, ListsByStateAndUserWhateverTheSizeOfAPage) {
  ASSERT_TRUE(Start().ok());
  const job::JobId done = SubmitFor("ann", "done", Spec());
  {
    PumpedWorker worker(coordinator_.get(), 1);
    ASSERT_EQ(Finish(done, &worker).state(), v1::JOB_STATE_DONE);
  }
  ASSERT_TRUE(Cancel(SubmitFor("ben", "cancelled", Spec())).ok());
  SubmitFor("ann", "planned", Spec());
  SubmitFor("ben", "submitted", UnplannedSpec());
  for (const int limit : {1, 2, 1000}) {
    EXPECT_THAT(Names(Of({}), limit), ElementsAre("submitted", "planned", "cancelled", "done"));
    EXPECT_THAT(Names(Of({}, "ann"), limit), ElementsAre("planned", "done"));
    EXPECT_THAT(Names(Of({v1::JOB_STATE_PLANNED}), limit), ElementsAre("planned"));
    EXPECT_THAT(Names(Of({v1::JOB_STATE_SUBMITTED, v1::JOB_STATE_DONE}), limit),
                ElementsAre("submitted", "done"));
    EXPECT_THAT(Names(Of({v1::JOB_STATE_CANCELLED}, "ann"), limit), IsEmpty());
  }
  const v1::ListJobsResponse all = *queries().ListJobs(Of({}));
  EXPECT_FALSE(all.jobs(0).has_settings());
  EXPECT_TRUE(queries().GetJob(all.jobs(0).job_id())->has_settings());
  for (const char* token : {"0", "-1", "x"}) {
    v1::ListJobsRequest request;
    request.set_page_token(token);
    EXPECT_TRUE(absl::IsInvalidArgument(queries().ListJobs(request).status())) << token;
  }
  for (const int limit : {-1, 1001}) {
    v1::ListJobsRequest request;
    request.set_limit(limit);
    EXPECT_TRUE(absl::IsInvalidArgument(queries().ListJobs(request).status())) << limit;
  }
}

TEST_F(JobQueriesTest, AFrameIsOpenedOnceItIsFinished) {
  ASSERT_TRUE(Start().ok());
  v1::JobSpec spec = Spec();
  spec.set_first_frame(3);
  spec.set_frame_count(2);
  const job::JobId job = Submit(spec);
  const auto open = [&](const std::string& id, int frame, uint64_t offset = 0) {
    v1::DownloadResultRequest request;
    request.set_job_id(id);
    request.set_frame(frame);
    request.set_offset(offset);
    return queries().OpenResult(request);
  };
  EXPECT_EQ(*coordinator_->CountUnits(job, 3), 0);
  EXPECT_THAT(open(job.value(), 3).status().ToString(), HasSubstr("FAILED_PRECONDITION: frame 3 of job"));
  for (const int frame : {2, 5}) {
    EXPECT_TRUE(absl::IsNotFound(open(job.value(), frame).status())) << frame;
    EXPECT_TRUE(absl::IsNotFound(coordinator_->CountUnits(job, frame).status())) << frame;
  }
  EXPECT_TRUE(absl::IsNotFound(open("j-none", 3).status()));
  {
    PumpedWorker worker(coordinator_.get(), 2);
    Deliver(&worker, 2);  // of the first frame
    Await([&] { return open(job.value(), 3).ok(); });
    EXPECT_EQ(*coordinator_->CountUnits(job, 3), kFinishedUnits);
    EXPECT_TRUE(absl::IsFailedPrecondition(open(job.value(), 4).status()));
    Finish(job, &worker);
  }
  const std::string result = Result(job, 3);
  v1::ByteChunk chunk;
  absl::StatusOr<rpc::ByteSender> sender = open(job.value(), 3, 7);
  ASSERT_TRUE(*sender->Next(&chunk));
  EXPECT_EQ(chunk.offset(), 7u);
  EXPECT_EQ(chunk.data(), result.substr(7));
  EXPECT_TRUE(absl::IsOutOfRange(open(job.value(), 3, result.size() + 1).status()));
  const job::JobId cancelled = Submit(spec, "cancelled");
  ASSERT_TRUE(Cancel(cancelled).ok());
  EXPECT_TRUE(absl::IsFailedPrecondition(coordinator_->CountUnits(cancelled, 3).status()));
}

TEST_F(JobQueriesTest, UsageIsOfDaysAndUsers) {
  ASSERT_TRUE(Start().ok());
  for (const char* user : {"ann", "ben"}) {
    const job::JobId job = SubmitFor(user, user, Spec());
    PumpedWorker worker(coordinator_.get(), 1);
    ASSERT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
  }
  const auto usage = [&](const std::string& user, absl::Time since, absl::Time until) {
    v1::GetUsageRequest request;
    request.set_user(user);
    request.set_since_unix_ms(absl::ToUnixMillis(since));
    if (until != absl::InfiniteFuture()) request.set_until_unix_ms(absl::ToUnixMillis(until));
    return *queries().GetUsage(request);
  };
  const absl::Time now = absl::Now(), end = absl::InfiniteFuture();
  EXPECT_EQ(usage("", now - absl::Hours(48), end).jobs_size(), 2);
  EXPECT_FALSE(usage("", now - absl::Hours(48), end).is_cut());
  const v1::GetUsageResponse of_ann = usage("ann", now - absl::Hours(48), end);
  ASSERT_EQ(of_ann.jobs_size(), 1);
  EXPECT_EQ(of_ann.jobs(0).user(), "ann");
  EXPECT_EQ(of_ann.jobs(0).units(), 2);
  EXPECT_EQ(of_ann.jobs(0).frames(), 1);
  EXPECT_GT(of_ann.jobs(0).finish_seconds(), 0);
  EXPECT_EQ(usage("", now + absl::Hours(48), end).jobs_size(), 0);
  EXPECT_EQ(usage("", now - absl::Hours(96), now - absl::Hours(48)).jobs_size(), 0);
}

TEST_F(JobQueriesTest, EventsAreOfAJobOrOfAWorker) {
  ASSERT_TRUE(Start().ok());
  const job::JobId job = Submit(Spec());
  const auto log = [&](const std::string& of_job, const std::string& worker, int limit = 0) {
    v1::GetLogRequest request;
    request.set_job_id(of_job);
    request.set_worker(worker);
    request.set_limit(limit);
    return queries().GetLog(request);
  };
  EXPECT_TRUE(absl::IsInvalidArgument(log("", "").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(log(job.value(), "ann").status()));
  EXPECT_TRUE(absl::IsInvalidArgument(log(job.value(), "", 1001).status()));
  EXPECT_TRUE(absl::IsNotFound(log("j-none", "").status()));
  EXPECT_TRUE(absl::IsNotFound(log("", "nobody").status()));
  EXPECT_TRUE(log(job.value(), "").ok()) << "a job without events is no error";
}

}  // namespace
}  // namespace lumifold::server
