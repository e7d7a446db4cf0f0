#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "filter/blocks.h"
#include "filter/layers/guide.h"
#include "filter/manifold/filter_device.h"
#include "filter/manifold/nlm_space.h"
#include "filter/methods.h"
#include "filter/opencl/device.h"
#include "filter/opencl/open_device.h"
#include "tests/unit/filter/are_equal.h"
#include "tests/unit/filter/edge_films.h"
#include "tests/unit/filter/fragment_films.h"
#include "tests/unit/filter/manifold_inputs.h"
#include "tests/unit/filter/synthetic_film.h"

namespace lumifold::filter {
namespace {

/// A pool with the first device that gives this processor's bits: a driver that plays a device on a processor
/// will do.
class OpenCl : public testing::Test {
 protected:
  void SetUp() override {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "drivers are built without the sanitizer";
#endif
    setenv("POCL_CACHE_DIR", LUMIFOLD_DEVICE_CACHE, /*overwrite=*/0);
    const auto devices = ListDevices();
    if (!devices.ok()) GTEST_SKIP() << devices.status();
    const auto found = std::find_if(devices->begin(), devices->end(), [](const DeviceInfo& device) {
      return device.refusal.empty() && device.other_bits.empty();
    });
    if (found == devices->end()) GTEST_SKIP() << "of " << devices->size() << " devices, none gives the bits";
    const auto number = std::to_string(found - devices->begin());
    auto device = OpenFilterDevice({.word = "gpu:" + number},
                                   [this](bool, const std::string& line) { warnings_.push_back(line); });
    ASSERT_TRUE(device.ok()) << device.status();
    pool_ = WithDevice(MakeTaskPool(2), device->device);
  }
  void TearDown() override {
    for (const std::string& warning : warnings_) ADD_FAILURE() << warning;
  }

  void ExpectSame(const ManifoldInput& input, const ManifoldParams& params, float reach,
                  const SlicePoints* points) {
    const auto run = [&](TaskPool* pool) {
      return ManifoldFilterAtPoints(input.signals, input.features, input.mask.view(), params, reach, points,
                                    pool);
    };
    const ManifoldResult here = run(nullptr);
    const ManifoldResult there = run(pool_.get());
    EXPECT_TRUE(AreEqual(here.filtered, there.filtered));
    EXPECT_EQ(here.points.values, there.points.values);
    EXPECT_EQ(here.points.weights, there.points.weights);
  }

  void ExpectSame(const LayeredImage& film, const LayeredImage* edges, const std::string& method) {
    const auto here = FilterFilm(film, method, nullptr, edges);
    const auto there = FilterFilm(film, method, pool_.get(), edges);
    ASSERT_TRUE(here.ok() && there.ok()) << here.status() << there.status();
    EXPECT_TRUE(AreEqual(*here, *there));
  }

  std::vector<std::string> warnings_;
  std::unique_ptr<TaskPool> pool_;
};

TEST_F(OpenCl, GivesTheBitsOfThisProcessorForPicturesOfAnySize) {
  constexpr std::pair<int, int> kSizes[] = {{37, 29}, {64, 40}, {1, 17}, {23, 1}, {1, 1}, {70, 301}};
  for (const auto& [width, height] : kSizes) {
    SCOPED_TRACE(testing::Message() << width << " x " << height);
    const ManifoldInput input = MakeManifoldInput(width, height, 4, true, 11);
    for (const bool fits : {false, true}) {
      ExpectSame(input, {.keeps_mass = fits, .is_first_order = fits}, fits ? 16.0f : 5.0f, nullptr);
      ExpectSame(input, {.height = 1, .is_first_order = fits}, 16, nullptr);
    }
  }
}

TEST_F(OpenCl, GivesTheBitsOfThisProcessorForCellsOfAnySize) {
  const ManifoldInput input = MakeManifoldInput(75, 50, 3, true, 12);
  for (const int cell : {1, 2, 16, 64}) {
    SCOPED_TRACE(cell);
    ExpectSame(input, {.height = 5, .cell = cell, .is_first_order = true}, 16, nullptr);
  }
}

TEST_F(OpenCl, GivesTheBitsOfThisProcessorForPoints) {
  const ManifoldInput input = MakeManifoldInput(75, 50, 4, true, 13);
  for (const size_t samples : {size_t{1}, size_t{3}}) {
    SlicePoints points = MakePoints(input, samples, 2);
    ExpectSame(input, {.height = 3}, 16, &points);
    AddSignals(3, &points);
    for (const bool fits : {false, true})
      ExpectSame(input, {.keeps_mass = fits, .is_first_order = fits}, 5, &points);
  }
}

TEST_F(OpenCl, GivesTheBitsOfThisProcessorForGuidesWhosePatchesItProjects) {
  for (const auto& [width, height] : {std::pair(37, 29), {1, 17}, {23, 1}}) {
    const ManifoldInput input = MakeManifoldInput(width, height, 2, true, 16);
    SlicePoints points = MakePoints(input, 2, 2);
    AddSignals(3, &points);
    for (const int radius : {1, 3}) {
      SCOPED_TRACE(testing::Message() << width << " x " << height << ", radius " << radius);
      const PatchBasis basis =
          FitPatchBasis(input.signals, input.mask.view(), {.radius = radius, .most_dimensions = 5}, nullptr);
      const JointGuide guide = MakeJointGuide(Clone(input.signals), basis, 0.5f, input.features);
      const ManifoldInput other = MakeManifoldInput(width, height, 2, false, 17);
      const std::vector<GuidedFiltering> filterings = {
          {input.signals, nullptr, guide, 1, input.mask.view(), &points},
          {other.signals, &input.signals, guide, 0.7f, input.mask.view(), nullptr}};
      const auto run = [&](TaskPool* pool) { return FilterGuided(filterings, {.height = 3}, 16, pool); };
      const std::vector<ManifoldResult> here = run(nullptr), there = run(pool_.get());
      for (size_t i = 0; i < 2; ++i) {
        EXPECT_TRUE(AreEqual(here[i].filtered, there[i].filtered));
        EXPECT_EQ(here[i].points.values, there[i].points.values);
      }
    }
  }
}

TEST_F(OpenCl, GivesTheBitsOfThisProcessorForAllMethodsAndFilms) {
  const LayeredImage edges = EdgeSet();
  struct Case {
    const char* name;
    LayeredImage film;
    const LayeredImage* edges = nullptr;
  };
  std::vector<Case> cases;
  cases.push_back({"odd sizes", MakeSyntheticFilm(61, 43, 0.3f, 3).film});
  cases.push_back({"one pixel wide", MakeSyntheticFilm(1, 33, 0.3f, 4).film});
  cases.push_back({"one pixel high", MakeSyntheticFilm(37, 1, 0.3f, 5).film});
  cases.push_back({"one pixel", MakeSyntheticFilm(1, 1, 0.3f, 6).film});
  cases.push_back({"edges", EdgeFilm(), &edges});
  cases.push_back({"levels", MirrorFilm()});
  std::vector<std::string> methods = {"manifolds-color:patch=3"};
  for (const MethodInfo& method : Methods()) methods.emplace_back(method.name);
  for (const Case& c : cases) {
    for (const std::string& method : methods) {
      SCOPED_TRACE(std::string(c.name) + ", " + method);
      ExpectSame(c.film, c.edges, method);
    }
  }
}

TEST_F(OpenCl, GivesTheBitsOfThisProcessorForFragments) {
  const LayeredImage edges = EdgeSet();
  const FilmOfFragments film = RoughFilmWithFragments(1);
  for (const char* method : {"default", "paper"}) {
    const auto here = FilterFilm(film.film, method, nullptr, &edges, &film.fragments);
    const auto there = FilterFilm(film.film, method, pool_.get(), &edges, &film.fragments);
    ASSERT_TRUE(here.ok() && there.ok()) << here.status() << there.status();
    EXPECT_TRUE(AreEqual(*here, *there)) << method;
  }
}

TEST_F(OpenCl, GivesTheBitsOfThisProcessorForFilmsInBlocks) {
  const LayeredImage film = MakeSyntheticFilm(100, 40, 0.3f, 3).film;
  constexpr BlockParams kSmall = {.core = 64, .margin = 64, .fade = 16, .whole = 0};
  for (const char* method : {"default", "paper"}) {
    SCOPED_TRACE(method);
    FilmInMemory source(film, nullptr, nullptr);
    const auto here = FilterFilmByRows(&source, method, nullptr, kSmall);
    const auto there = FilterFilmByRows(&source, method, pool_.get(), kSmall);
    ASSERT_TRUE(here.ok() && there.ok());
    EXPECT_TRUE(AreEqual(*here, *there));
  }
}

/// A run on a device that is lost.
class LostRun final : public KernelRun {
 public:
  void Use(const ProgramOptions&) override {}
  Buffer Allocate(size_t) override { return {}; }
  void Release(Buffer) override {}
  void Write(Buffer, size_t, const void*, size_t) override {}
  void Copy(Buffer, size_t, Buffer, size_t, size_t) override {}
  void Run(const char*, size_t, std::initializer_list<Argument>) override {}
  absl::Status Finish() override { return absl::InternalError("it is lost"); }
  absl::Status Read(Buffer, size_t, size_t, void*) override { return Finish(); }
};

class LostDevice final : public Device {
 public:
  explicit LostDevice(int* calls) : calls_(*calls) {}
  DeviceMemory Memory() const override { return {}; }
  std::unique_ptr<KernelRun> Begin() override {
    ++calls_;
    return std::make_unique<LostRun>();
  }

 private:
  int& calls_;
};

TEST(FilterDevice, IsLeftForTheProcessorWithOneWarningWhenItFails) {
  int calls = 0;
  std::vector<std::string> warnings;
  const auto pool =
      WithDevice(MakeTaskPool(2),
                 MakeFilterDevice(std::make_unique<LostDevice>(&calls),
                                  [&](bool, const std::string& reason) { warnings.push_back(reason); }));
  const ManifoldInput input = MakeManifoldInput(40, 30, 3, true, 14);
  const auto run = [&](TaskPool* with) {
    return ManifoldFilter(input.signals, input.features, input.mask.view(), {}, with);
  };
  const Planes expected = run(nullptr);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(AreEqual(run(pool.get()), expected));
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(warnings, std::vector<std::string>{"it is lost"});
}

TEST(FilterDevice, IsOneOfFourWords) {
  for (const char* word : {"auto", "cpu", "gpu", "gpu:0", "gpu:12"})
    EXPECT_TRUE(CheckDeviceChoice(word).ok()) << word;
  for (const char* word : {"", "GPU", "gpu:", "gpu:-1", "gpu:x", "cpu:1", "cuda"}) {
    const absl::Status status = OpenFilterDevice({.word = word}, nullptr).status();
    EXPECT_EQ(status.message(),
              "\"" + std::string(word) + "\" is no device; there are: auto, cpu, gpu, gpu:N");
  }
}

TEST(FilterDevice, IsNeverAProcessorUnlessItsNumberIsGiven) {
  const auto devices = ListDevices();
  const bool has_gpu =
      devices.ok() && std::any_of(devices->begin(), devices->end(), [](const DeviceInfo& device) {
        return device.is_gpu && device.refusal.empty() && device.other_bits.empty();
      });
  const auto found = OpenFilterDevice({.word = "auto"}, [](bool, const std::string&) {});
  ASSERT_TRUE(found.ok()) << found.status();
  EXPECT_EQ(found->device != nullptr, has_gpu);
  EXPECT_EQ(OpenFilterDevice({.word = "gpu"}, [](bool, const std::string&) {}).ok(), has_gpu);
  EXPECT_EQ(OpenFilterDevice({.word = "cpu"}, nullptr)->device, nullptr);
  EXPECT_FALSE(OpenFilterDevice({.word = "gpu:4000"}, nullptr).ok());
}

}  // namespace
}  // namespace lumifold::filter
