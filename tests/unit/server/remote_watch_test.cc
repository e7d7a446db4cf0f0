#include "server/cluster/remote_watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "server/cluster/farm_peers.h"

namespace lumifold::server {
namespace {

using ::testing::HasSubstr;

TEST(RemoteWatch, NamesTheCoordinatorThatDoesNotAnswer) {
  const std::string nobody = "127.0.0.1:1";
  cluster::FarmPeers peers;
  peers.Join({.security = {}, .wall_now = absl::Now, .self = {}, .owner_of = {}}, nullptr);
  absl::Status end;
  absl::Notification ended;
  v1::WatchJobRequest request;
  request.set_job_id("job-1");
  const std::shared_ptr<cluster::RemoteWatch> watch = cluster::RemoteWatch::Start(
      {nobody, rpc::MakeChannel(nobody, {}, rpc::kQuickKeepAlive)}, peers, access::LocalIdentity(), "",
      request,
      {.on_status = [](const v1::JobStatus&) { ADD_FAILURE() << "nobody is there"; },
       .on_end =
           [&](const absl::Status& status) {
             end = status;
             ended.Notify();
           }});
  ended.WaitForNotification();
  EXPECT_EQ(end.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(end.message()), HasSubstr("the coordinator at 127.0.0.1:1 does not answer: "));
  watch->Stop();
}

}  // namespace
}  // namespace lumifold::server
