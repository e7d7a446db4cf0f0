#include "proto/device/device_process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/manifold/filter_device.h"
#include "filter/opencl/device.h"
#include "proto/rpc/monotonic.h"
#include "tests/unit/filter/manifold_inputs.h"

namespace lumifold::device {
namespace {

using testing::ElementsAre;
using testing::EndsWith;
using testing::HasSubstr;

/// Processes of the client, with a library of OpenCL that fails as it is told.
class Device : public testing::Test {
 protected:
  void SetUp() override {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "drivers are built without the sanitizer";
#endif
    const auto devices = filter::ListDevices();
    if (!devices.ok() || devices->empty() || !devices->front().refusal.empty())
      GTEST_SKIP() << "no device gives this processor's bits";
    setenv("POCL_CACHE_DIR", LUMIFOLD_DEVICE_CACHE, /*overwrite=*/0);
    setenv("LD_LIBRARY_PATH", LUMIFOLD_FAULTY_OPENCL, /*overwrite=*/1);
  }
  void TearDown() override {
    unsetenv("FAULTY_OPENCL");
    unsetenv("FAULTY_OPENCL_LACKS");
    unsetenv("FAULTY_OPENCL_MEMORY");
  }

  DeviceProcessOptions Options(absl::Duration limit = absl::Seconds(150)) {
    return {.program = LUMIFOLD_PROGRAM,
            .choice = {.word = "gpu:0"},
            .time_limit = limit,
            .warn = [this](const std::string& line) {
              const std::lock_guard lock(mutex_);
              warnings_.push_back(line);
            }};
  }

  static Planes Filter(TaskPool* pool, int width = 40, int height = 30) {
    const filter::ManifoldInput input = filter::MakeManifoldInput(width, height, 3, true, 14);
    return filter::ManifoldFilter(input.signals, input.features, input.mask.view(), {}, pool);
  }
  static bool FiltersOn(filter::FilterDevice& device, int width = 40, int height = 30) {
    const filter::ManifoldInput input = filter::MakeManifoldInput(width, height, 3, true, 14);
    const filter::ManifoldParams params;
    const filter::ManifoldCall call = {filter::ViewsOf(input.signals),
                                       {},
                                       filter::ViewsOf(input.features),
                                       input.mask.view(),
                                       params,
                                       16,
                                       nullptr};
    return device.Filter(call).has_value();
  }
  static void ExpectExpected(const Planes& found) {
    const Planes expected = Filter(nullptr, found[0].width(), found[0].height());
    ASSERT_EQ(found.size(), expected.size());
    for (size_t c = 0; c < found.size(); ++c) {
      for (int y = 0; y < found[0].height(); ++y) {
        for (int x = 0; x < found[0].width(); ++x)
          ASSERT_EQ(found[c].At(x, y), expected[c].At(x, y)) << x << ' ' << y;
      }
    }
  }
  /// With this in the environment the device filters, and gives the picture of the processor.
  void ExpectFiltersWith(const char* variable, const char* value) {
    SCOPED_TRACE(value);
    setenv(variable, value, /*overwrite=*/1);
    const auto device = OpenDevice(Options());
    ASSERT_TRUE(device.ok()) << device.status();
    EXPECT_TRUE(FiltersOn(*device->device));
    ExpectExpected(Filter(filter::WithDevice(MakeTaskPool(1), device->device).get()));
    EXPECT_TRUE(warnings_.empty());
  }
  /// Filters with a device that has this fault: the picture is the processor's, and one warning is given.
  void ExpectTakenOver(const char* fault, const std::string& reason,
                       absl::Duration limit = absl::Seconds(150)) {
    SCOPED_TRACE(fault);
    warnings_.clear();
    setenv("FAULTY_OPENCL", fault, /*overwrite=*/1);
    const auto device = OpenDevice(Options(limit));
    ASSERT_TRUE(device.ok()) << device.status();
    const auto pool = filter::WithDevice(MakeTaskPool(1), device->device);
    for (int i = 0; i < 2; ++i) ExpectExpected(Filter(pool.get()));
    EXPECT_THAT(warnings_, ElementsAre(testing::AllOf(HasSubstr(" fails, this processor filters instead: "),
                                                      HasSubstr(reason))));
  }

  std::mutex mutex_;
  std::vector<std::string> warnings_;
};

TEST_F(Device, InAProcessGivesTheBitsOfThisProcessorToAllWhoAsk) {
  const auto process = DeviceProcess::Start(Options());
  ASSERT_TRUE(process.ok()) << process.status();
  std::vector<std::thread> callers(3);
  for (std::thread& caller : callers) {
    caller = std::thread([&] {
      const std::shared_ptr<filter::FilterDevice> link = (*process)->Link();
      const filter::ManifoldInput input = filter::MakeManifoldInput(37, 29, 4, true, 15);
      filter::SlicePoints points = filter::MakePoints(input, 2, 2);
      filter::AddSignals(3, &points);
      const filter::ManifoldParams params = {.keeps_mass = true, .is_first_order = true};
      const filter::ManifoldCall call = {filter::ViewsOf(input.signals),
                                         {},
                                         filter::ViewsOf(input.features),
                                         input.mask.view(),
                                         params,
                                         5,
                                         &points};
      const auto found = link->Filter(call);
      ASSERT_TRUE(found.has_value());
      const filter::ManifoldResult expected = filter::ManifoldFilterAtPoints(
          input.signals, input.features, input.mask.view(), params, 5, &points, nullptr);
      EXPECT_EQ(found->points.values, expected.points.values);
      EXPECT_EQ(found->points.weights, expected.points.weights);
      EXPECT_EQ(found->filtered[1].At(20, 10), expected.filtered[1].At(20, 10));
    });
  }
  for (std::thread& caller : callers) caller.join();
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(Device, ThatFailsIsLeftForTheProcessorWithOneWarning) {
  ExpectTakenOver("clBuildProgram:1:-11", "clBuildProgram: OpenCL error -11");
  ExpectTakenOver("clEnqueueWriteBuffer:5:-36", "clEnqueueWriteBuffer: OpenCL error -36");
  ExpectTakenOver("clFinish:2:-14", "clFinish: OpenCL error -14");
  ExpectTakenOver("clFinish:2:crash", "its driver has crashed");
}

TEST_F(Device, WithLittleMemoryGivesTheBitsOfThisProcessor) {
  // 40 x 30 pixels in cells of 2 x 2 take 600 kB at once, 250 kB in turns.
  for (const char* bytes : {"500000", "300000"}) ExpectFiltersWith("FAULTY_OPENCL_MEMORY", bytes);
}

TEST_F(Device, WhoseMemoryOthersUseTakesLess) {
  for (const char* fault : {"clCreateBuffer:9:-4", "clEnqueueNDRangeKernel:9:-5"})
    ExpectFiltersWith("FAULTY_OPENCL", fault);
}

TEST_F(Device, WithTooLittleMemoryLeavesWhatNeedsMoreWithOneWarning) {
  setenv("FAULTY_OPENCL_MEMORY", "220000", /*overwrite=*/1);
  const auto device = OpenDevice(Options());
  ASSERT_TRUE(device.ok()) << device.status();
  const auto pool = filter::WithDevice(MakeTaskPool(1), device->device);
  for (int i = 0; i < 2; ++i) ExpectExpected(Filter(pool.get(), 80, 60));
  EXPECT_THAT(warnings_,
              ElementsAre(testing::AllOf(HasSubstr(" leaves what needs more memory to this processor: "),
                                         HasSubstr("it has 0.2 MB of memory"))));
  EXPECT_TRUE(FiltersOn(*device->device, 10, 10)) << "smaller pictures stay";
}

TEST_F(Device, ThatHangsIsLeftForTheProcessorWithinItsTime) {
  const absl::Time start = rpc::MonotonicNow();
  for (const char* fault : {"clFinish:1:hang", "clBuildProgram:1:hang", "clEnqueueWriteBuffer:1:hang"})
    ExpectTakenOver(fault, "it does not answer", absl::Seconds(3));  // the opening included
  EXPECT_LT(rpc::MonotonicNow() - start, absl::Seconds(60));
}

TEST_F(Device, WhoseDriverHangsWhenItIsOpenedIsAnError) {
  setenv("FAULTY_OPENCL", "clGetPlatformIDs:1:hang", /*overwrite=*/1);
  const auto process = DeviceProcess::Start(Options(absl::Seconds(1)));
  EXPECT_EQ(process.status().message(), "the driver of the device does not answer");
}

TEST_F(Device, ThatIsNotThereIsAnError) {
  DeviceProcessOptions options = Options();
  options.choice.word = "gpu:4000";
  EXPECT_THAT(std::string(DeviceProcess::Start(options).status().message()),
              EndsWith("there is no device 4000 of OpenCL"));
  options.choice.word = "gpus";
  EXPECT_EQ(DeviceProcess::Start(options).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(Device, OfOtherBitsIsTakenWhereThatIsAllowedAndSaysSo) {
  DeviceProcessOptions options = Options();
  for (const auto& [lacks, reason] :
       {std::pair("rounding", "it does not round quotients and roots correctly"),
        std::pair("denormals", "it has no denormal numbers")}) {
    setenv("FAULTY_OPENCL_LACKS", lacks, /*overwrite=*/1);
    options.choice.allows_other_bits = false;
    EXPECT_THAT(
        std::string(DeviceProcess::Start(options).status().message()),
        EndsWith(absl::StrCat("has other bits: ", reason, ". --allow-other-bits takes it all the same")));
    options.choice.allows_other_bits = true;
    const auto process = DeviceProcess::Start(options);
    ASSERT_TRUE(process.ok()) << process.status();
    EXPECT_THAT((*process)->other_bits(), testing::MatchesRegex("[0-9a-f]{8}"));
    const auto pool = filter::WithDevice(MakeTaskPool(1), (*process)->Link());
    EXPECT_EQ(filter::DeviceOf(pool.get())->OtherBits(), (*process)->other_bits());
    EXPECT_EQ(Filter(pool.get()).size(), 3);
  }
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(Device, WithoutDoublePrecisionGivesTheBitsOfThisProcessor) {
  setenv("FAULTY_OPENCL_LACKS", "doubles", /*overwrite=*/1);
  const auto process = DeviceProcess::Start(Options());
  ASSERT_TRUE(process.ok()) << process.status();
  EXPECT_EQ((*process)->other_bits(), "");
  const auto pool = filter::WithDevice(MakeTaskPool(1), (*process)->Link());
  ExpectExpected(Filter(pool.get()));
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(Device, ThatHasFailedIsOfferedToNobody) {
  setenv("FAULTY_OPENCL", "clFinish:1:-14", /*overwrite=*/1);
  const auto process = DeviceProcess::Start(Options());
  ASSERT_TRUE(process.ok()) << process.status();
  const auto pool = filter::WithDevice(MakeTaskPool(1), (*process)->Link());
  ExpectExpected(Filter(pool.get()));
  EXPECT_LT((*process)->Connect().get(), 0);
  EXPECT_EQ(warnings_.size(), 1);
}

}  // namespace
}  // namespace lumifold::device
