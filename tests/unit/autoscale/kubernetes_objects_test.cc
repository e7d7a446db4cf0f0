#include "client/autoscale/kubernetes_objects.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::autoscale {
namespace {

using testing::ElementsAre;
using State = Request::State;

TEST(KubernetesObjects, ReadsAScale) {
  const auto scale = ParseScale(
      R"({"metadata":{"resourceVersion":"17"},"spec":{"replicas":3},"status":{"selector":"app=worker"}})");
  ASSERT_TRUE(scale.ok()) << scale.status();
  EXPECT_EQ(scale->replicas, 3);
  EXPECT_EQ(scale->selector, "app=worker");
  EXPECT_EQ(scale->version, "17");
}

TEST(KubernetesObjects, RefusesWhatIsNoObjectOfItsKind) {
  for (const char* text :
       {"", "[]", "{}", "<html>", R"({"metadata":{"resourceVersion":"1"},"spec":{"replicas":-1}})",
        R"({"metadata":[],"spec":"x","status":{"selector":7}})"}) {
    EXPECT_EQ(ParseScale(text).status().code(), absl::StatusCode::kDataLoss) << text;
  }
  EXPECT_FALSE(ParsePods("[]", 1).ok());
  EXPECT_FALSE(ParsePods(R"({"items":[{}]})", 1).ok());
  EXPECT_TRUE(ParsePods(R"({"items":"none"})", 1).ok());
}

TEST(KubernetesObjects, ReadsPodsInTheirStates) {
  const auto page = ParsePods(R"({"metadata":{"continue":"more"},"items":[
    {"metadata":{"name":"a","annotations":{"controller.kubernetes.io/pod-deletion-cost":"-1000"}},
     "spec":{"containers":[{"resources":{"requests":{"cpu":"1500m"}}},{"resources":{"limits":{"cpu":"2"}}}]},
     "status":{"phase":"Running","startTime":"2026-03-01T10:00:00Z"}},
    {"metadata":{"name":"b"},"status":{"phase":"Pending","conditions":[
      {"type":"PodScheduled","status":"False","message":"0/3 nodes are available"}]}},
    {"metadata":{"name":"c"},"status":{"phase":"Running","containerStatuses":[
      {"state":{"waiting":{"reason":"CrashLoopBackOff"}}}]}},
    {"metadata":{"name":"d","deletionTimestamp":"2026-03-01T10:00:00Z"},"status":{"phase":"Running"}},
    {"metadata":{"name":"e"},"status":{"phase":"Failed","reason":"Evicted"}},
    {"metadata":{"name":"f"},"status":{"phase":"Failed","startTime":"2026-03-01T10:00:00Z","containerStatuses":[
      {"state":{"terminated":{"finishedAt":"2026-03-01T10:00:07Z"}}}]}}]})",
                              4);
  ASSERT_TRUE(page.ok()) << page.status();
  EXPECT_EQ(page->next, "more");
  EXPECT_THAT(page->marked, ElementsAre("a"));
  std::vector<State> states;
  for (const Request& pod : page->pods) states.push_back(pod.state);
  EXPECT_THAT(states, ElementsAre(State::kRunning, State::kPending, State::kPending, State::kLeaving,
                                  State::kEnded, State::kEnded));
  EXPECT_EQ(page->pods[0].cores, 3.5);
  EXPECT_EQ(page->pods[1].cores, 4);
  EXPECT_EQ(page->pods[1].detail, "0/3 nodes are available");
  EXPECT_EQ(page->pods[2].detail, "CrashLoopBackOff");
  EXPECT_EQ(page->pods[4].end, Request::End::kTaken);
  EXPECT_EQ(page->pods[5].end, Request::End::kFailed);
  EXPECT_EQ(page->pods[5].ended - page->pods[5].started, absl::Seconds(7));
}

TEST(KubernetesObjects, ReadsWhyPodsAreNotMade) {
  EXPECT_EQ(*ParseReplicaFailure(R"({"status":{"conditions":[{"type":"Available","status":"True"},
    {"type":"ReplicaFailure","status":"True","message":"exceeded quota"}]}})"),
            "exceeded quota");
  EXPECT_EQ(*ParseReplicaFailure("{}"), "");
}

TEST(KubernetesObjects, ShowsErrorsThatAreNoJson) {
  EXPECT_EQ(MessageOf(R"({"kind":"Status","message":"forbidden"})"), "forbidden");
  EXPECT_EQ(MessageOf("<html>\n"), "<html>\\n");
}

}  // namespace
}  // namespace lumifold::autoscale
