#include "client/farm/coordinators.h"

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <map>

#include "proto/retry/storage_away.h"
#include "proto/rpc/status_codec.h"
#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

// Calls that never reach a network: the channels only say which coordinator was called.
class CoordinatorsTest : public testing::Test {
 protected:
  Coordinators Make(std::vector<std::string> addresses) {
    options_.coordinators = std::move(addresses);
    options_.time = test_.environment.time;
    options_.interrupted = test_.environment.interrupted;
    return Coordinators(options_, [this](const std::string& address) {
      connected_.push_back(address);
      auto channel = rpc::MakeChannel(address, rpc::Security{});
      names_[channel.get()] = address;
      return channel;
    });
  }

  // The answer is that of the coordinator's name.
  grpc::Status Answer(grpc::ClientContext& context, const std::shared_ptr<grpc::Channel>& channel) {
    const std::string& name = names_.at(channel.get());
    called_.push_back(name);
    deadlines_.push_back(context.deadline());
    const auto code = codes_.find(name);
    return code == codes_.end() ? grpc::Status::OK : grpc::Status(code->second, "told by " + name);
  }

  absl::Status Call(Coordinators& coordinators) {
    called_.clear();
    return coordinators.Call(
        kShortCall, [this](grpc::ClientContext& context, const std::shared_ptr<grpc::Channel>& channel) {
          return Answer(context, channel);
        });
  }

  TestEnvironment test_;
  FarmClientOptions options_;
  std::map<const grpc::Channel*, std::string> names_;
  std::map<std::string, grpc::StatusCode> codes_;
  std::vector<std::string> connected_;
  std::vector<std::string> called_;
  std::vector<std::chrono::system_clock::time_point> deadlines_;
};

TEST_F(CoordinatorsTest, GoesOnAtOnceAndStaysWhereItWasAnswered) {
  for (const auto lost :
       {grpc::StatusCode::UNAVAILABLE, grpc::StatusCode::DEADLINE_EXCEEDED, grpc::StatusCode::CANCELLED}) {
    codes_ = {{"a:1", lost}, {"b:1", lost}};
    Coordinators coordinators = Make({"a:1", "b:1", "c:1", "d:1"});
    EXPECT_EQ(Call(coordinators), absl::OkStatus());
    EXPECT_THAT(called_, ElementsAre("a:1", "b:1", "c:1"));
    EXPECT_EQ(Call(coordinators), absl::OkStatus());
    EXPECT_THAT(called_, ElementsAre("c:1"));
    codes_ = {{"c:1", lost}, {"d:1", lost}};
    EXPECT_EQ(Call(coordinators), absl::OkStatus());
    EXPECT_THAT(called_, ElementsAre("c:1", "d:1", "a:1"));
  }
  EXPECT_EQ(test_.time.sleeps, 0);
}

TEST_F(CoordinatorsTest, ConnectsToThoseItNeedsOnce) {
  codes_ = {{"a:1", grpc::StatusCode::UNAVAILABLE}};
  Coordinators coordinators = Make({"a:1", "b:1", "c:1"});
  EXPECT_THAT(connected_, IsEmpty());
  EXPECT_EQ(Call(coordinators), absl::OkStatus());
  EXPECT_EQ(Call(coordinators), absl::OkStatus());
  EXPECT_THAT(connected_, ElementsAre("a:1", "b:1"));
}

TEST_F(CoordinatorsTest, SpreadsOverTheListByItsRandomNumber) {
  for (const auto& [random, first] :
       {std::pair{0.0, "a:1"}, std::pair{0.34, "b:1"}, std::pair{0.67, "c:1"}, std::pair{0.999, "c:1"}}) {
    test_.environment.time.jitter = [random = random] { return random; };
    Coordinators coordinators = Make({"a:1", "b:1", "c:1"});
    EXPECT_EQ(Call(coordinators), absl::OkStatus());
    EXPECT_THAT(called_, ElementsAre(first));
  }
}

TEST_F(CoordinatorsTest, PausesOnceAllWereTriedAndNamesThem) {
  codes_ = {{"a:1", grpc::StatusCode::UNAVAILABLE}, {"b:1", grpc::StatusCode::DEADLINE_EXCEEDED}};
  Coordinators coordinators = Make({"a:1", "b:1"});
  EXPECT_EQ(Call(coordinators),
            absl::UnavailableError("cannot reach any of the coordinators a:1, b:1: told by b:1"));
  EXPECT_THAT(called_, ElementsAre("a:1", "b:1", "a:1", "b:1", "a:1", "b:1"));
  EXPECT_EQ(test_.time.sleeps, 2);
}

TEST_F(CoordinatorsTest, NamesTheOnlyOne) {
  codes_ = {{"a:1", grpc::StatusCode::UNAVAILABLE}};
  Coordinators coordinators = Make({"a:1"});
  EXPECT_EQ(Call(coordinators), absl::UnavailableError("cannot reach the coordinator at a:1: told by a:1"));
  EXPECT_THAT(called_, ElementsAre("a:1", "a:1", "a:1"));
}

TEST_F(CoordinatorsTest, WaitsWhileTheStorageOfTheFarmIsAway) {
  Coordinators coordinators = Make({"a:1", "b:1"});
  const absl::Time begin = test_.time.now;
  const auto call = [&](absl::Duration outage) {
    return coordinators.Call(kShortCall, [&](grpc::ClientContext&, const auto&) {
      return test_.time.now - begin < outage ? rpc::GrpcFromStatus(retry::StorageAway(
                                                   absl::UnavailableError("the database does not answer")))
                                             : grpc::Status::OK;
    });
  };
  EXPECT_EQ(call(absl::Seconds(8)), absl::OkStatus());
  EXPECT_LT(test_.time.now - begin, absl::Seconds(11));
  EXPECT_EQ(call(absl::InfiniteDuration()),
            absl::UnavailableError(
                "the storage of the farm is away, try again later: the database does not answer"));
  EXPECT_GE(test_.time.now - begin, absl::Seconds(36));
  EXPECT_LT(test_.time.now - begin, absl::Seconds(42));
}

TEST_F(CoordinatorsTest, WaitsForAnyAsLongAsIsAsked) {
  options_.patience_without_answer = absl::Seconds(60);
  codes_ = {{"a:1", grpc::StatusCode::UNAVAILABLE}};
  Coordinators coordinators = Make({"a:1"});
  const absl::Time begin = test_.time.now;
  EXPECT_TRUE(absl::IsUnavailable(Call(coordinators)));
  EXPECT_GE(test_.time.now - begin, absl::Seconds(57));
  EXPECT_LE(test_.time.now - begin, absl::Seconds(61));
}

TEST_F(CoordinatorsTest, WaitsLongerForSlowOnesOnceAllWereTried) {
  codes_ = {{"a:1", grpc::StatusCode::DEADLINE_EXCEEDED}, {"b:1", grpc::StatusCode::DEADLINE_EXCEEDED}};
  Coordinators two = Make({"a:1", "b:1"});
  EXPECT_FALSE(Call(two).ok());
  // 10 s from a later start, and 3 s from the first.
  EXPECT_GE(deadlines_[2] - deadlines_[0], std::chrono::seconds(6));
  deadlines_.clear();
  Coordinators one = Make({"a:1"});
  EXPECT_FALSE(Call(one).ok());
  EXPECT_LT(deadlines_[1] - deadlines_[0], std::chrono::seconds(6));
}

TEST_F(CoordinatorsTest, TakesAnAnswerOfTheCoordinatorForAnAnswer) {
  codes_ = {{"a:1", grpc::StatusCode::NOT_FOUND}};
  Coordinators coordinators = Make({"a:1", "b:1"});
  EXPECT_EQ(Call(coordinators), absl::NotFoundError("told by a:1"));
  EXPECT_THAT(called_, ElementsAre("a:1"));
}

TEST_F(CoordinatorsTest, EndsWhenTheUserInterrupts) {
  codes_ = {{"a:1", grpc::StatusCode::CANCELLED}};
  test_.interrupted = true;
  Coordinators coordinators = Make({"a:1", "b:1"});
  EXPECT_EQ(Call(coordinators), absl::CancelledError("interrupted"));
  EXPECT_THAT(called_, ElementsAre("a:1"));
}

TEST_F(CoordinatorsTest, MakesACallOnceAndTheNextOneElsewhere) {
  codes_ = {{"a:1", grpc::StatusCode::UNAVAILABLE}};
  Coordinators coordinators = Make({"a:1", "b:1"});
  EXPECT_EQ(coordinators.CallOnce(absl::Seconds(10),
                                  [this](grpc::ClientContext& context, const auto& channel) {
                                    return Answer(context, channel);
                                  }),
            absl::UnavailableError("cannot reach the coordinator at a:1: told by a:1"));
  EXPECT_THAT(called_, ElementsAre("a:1"));
  EXPECT_EQ(Call(coordinators), absl::OkStatus());
  EXPECT_THAT(called_, ElementsAre("b:1"));
}

TEST_F(CoordinatorsTest, OpensAStreamElsewhereUntilItIsAnswered) {
  codes_ = {{"a:1", grpc::StatusCode::UNAVAILABLE}, {"b:1", grpc::StatusCode::UNAVAILABLE}};
  Coordinators coordinators = Make({"a:1", "b:1", "c:1"});
  bool answered = false;
  EXPECT_EQ(coordinators.Stream(absl::Seconds(10), &answered,
                                [&](grpc::ClientContext& context, const auto& channel) {
                                  const grpc::Status status = Answer(context, channel);
                                  answered = called_.back() == "b:1";
                                  return status;
                                }),
            absl::UnavailableError("cannot reach the coordinator at b:1: told by b:1"));
  EXPECT_THAT(called_, ElementsAre("a:1", "b:1"));
  EXPECT_EQ(Call(coordinators), absl::OkStatus());
  EXPECT_THAT(called_, ElementsAre("c:1"));
}

}  // namespace
}  // namespace lumifold::client
