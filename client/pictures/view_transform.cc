#include "client/pictures/view_transform.h"

#include <OpenColorIO/OpenColorIO.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/pictures/tone_curves.h"

namespace lumifold::pictures {
namespace {

namespace ocio = OCIO_NAMESPACE;

constexpr char kLinear[] = "Linear Rec.709";
constexpr char kDisplay[] = "sRGB";

/// A space of the built-in configuration, and the view that shows it.
struct BuiltIn {
  const char* view;
  const char* space;
  void (*tone)(float rgb[3]) = nullptr;  // applied before, if there is one
};
constexpr std::array<BuiltIn, 5> kBuiltIn = {{{"standard", "sRGB"},
                                              {"filmic", "Filmic sRGB"},
                                              {"agx", "sRGB", AgX},
                                              {"neutral", "sRGB", PbrNeutral},
                                              {"raw", "Raw"}}};

/// Of 16 bits.
float FromHalf(uint32_t half) {
  const uint32_t sign = (half & 0x8000u) << 16;
  const uint32_t exponent = (half >> 10) & 0x1fu;
  const uint32_t mantissa = half & 0x3ffu;
  if (exponent == 0) return std::ldexp(static_cast<float>(mantissa), -24) * (sign != 0 ? -1.0f : 1.0f);
  if (exponent == 31) return std::bit_cast<float>(sign | 0x7f800000u | (mantissa << 13));
  return std::bit_cast<float>(sign | ((exponent + 112) << 23) | (mantissa << 13));
}

/// Source: Hable 2010, "Uncharted 2: HDR Lighting", with his constants; 11.2 becomes white.
float Filmic(float x) {
  const auto curve = [](float v) {
    return (v * (0.15f * v + 0.05f) + 0.004f) / (v * (0.15f * v + 0.5f) + 0.06f) - 0.02f / 0.3f;
  };
  return curve(2 * x) / curve(11.2f);
}

/// The curve at every number of 16 bits.
ocio::Lut1DTransformRcPtr FilmicTable() {
  constexpr unsigned long kHalves = 65536;
  ocio::Lut1DTransformRcPtr table = ocio::Lut1DTransform::Create(kHalves, /*inputHalfDomain=*/true);
  for (unsigned long i = 0; i < kHalves; ++i) {
    const float x = FromHalf(static_cast<uint32_t>(i));
    const float limited = std::isnan(x) ? 0.0f : std::clamp(x, 0.0f, 65504.0f);
    const float value = Filmic(limited);
    table->setValue(i, value, value, value);
  }
  return table;
}

ocio::TransformRcPtr SrgbCurve() {
  const ocio::ExponentWithLinearTransformRcPtr curve = ocio::ExponentWithLinearTransform::Create();
  constexpr double kGamma[4] = {2.4, 2.4, 2.4, 1.0};
  constexpr double kOffset[4] = {0.055, 0.055, 0.055, 0.0};
  curve->setGamma(kGamma);
  curve->setOffset(kOffset);
  curve->setDirection(ocio::TRANSFORM_DIR_INVERSE);
  return curve;
}

ocio::ColorSpaceRcPtr Space(const char* name, const ocio::ConstTransformRcPtr& from_linear) {
  ocio::ColorSpaceRcPtr space = ocio::ColorSpace::Create();
  space->setName(name);
  if (from_linear != nullptr) space->setTransform(from_linear, ocio::COLORSPACE_DIR_FROM_REFERENCE);
  return space;
}

ocio::ConstConfigRcPtr BuiltInConfig() {
  const ocio::ConfigRcPtr config = ocio::Config::Create();
  config->setMajorVersion(2);
  config->addColorSpace(Space(kLinear, nullptr));
  config->setRole(ocio::ROLE_SCENE_LINEAR, kLinear);
  config->addColorSpace(Space("sRGB", SrgbCurve()));
  const ocio::GroupTransformRcPtr filmic = ocio::GroupTransform::Create();
  filmic->appendTransform(FilmicTable());
  filmic->appendTransform(SrgbCurve());
  config->addColorSpace(Space("Filmic sRGB", filmic));
  const ocio::ColorSpaceRcPtr raw = Space("Raw", nullptr);
  raw->setIsData(true);
  config->addColorSpace(raw);
  for (const BuiltIn& view : kBuiltIn) config->addDisplayView(kDisplay, view.view, view.space, "");
  return config;
}

/// The studio's configuration; null: none is named.
ocio::ConstConfigRcPtr StudioConfig() {
  const char* const path = std::getenv("OCIO");
  return path == nullptr || *path == '\0' ? nullptr : ocio::Config::CreateFromEnv();
}

/// The space of our light in a studio's configuration, under the names that it has in those of ACES and of
/// others.
std::string LinearSpaceOf(const ocio::ConstConfigRcPtr& config) {
  for (const char* name : {"lin_rec709", "Linear Rec.709 (sRGB)", "lin_srgb", "Utility - Linear - sRGB",
                           "Utility - Linear - Rec.709", "Linear Rec.709", ocio::ROLE_SCENE_LINEAR}) {
    if (config->getColorSpace(name) != nullptr) return name;
  }
  return ocio::ROLE_SCENE_LINEAR;
}

/// The views of a studio's configuration, as "VIEW" of the default display and "DISPLAY/VIEW".
std::vector<std::string> ViewsOf(const ocio::ConstConfigRcPtr& config) {
  std::vector<std::string> views;
  const std::string first = config->getDefaultDisplay();
  for (int d = 0; d < config->getNumDisplays(); ++d) {
    const std::string display = config->getDisplay(d);
    for (int v = 0; v < config->getNumViews(display.c_str()); ++v) {
      const std::string view = config->getView(display.c_str(), v);
      if (display == first) views.push_back(view);
      views.push_back(absl::StrCat(display, "/", view));
    }
  }
  return views;
}

ocio::ConstCPUProcessorRcPtr ProcessorOf(const ocio::ConstConfigRcPtr& config, const std::string& from,
                                         const std::string& display, const std::string& view) {
  const ocio::DisplayViewTransformRcPtr transform = ocio::DisplayViewTransform::Create();
  transform->setSrc(from.c_str());
  transform->setDisplay(display.c_str());
  transform->setView(view.c_str());
  return config->getProcessor(transform)->getDefaultCPUProcessor();
}

void (*ToneOf(const std::string& view))(float rgb[3]) {
  for (const BuiltIn& built_in : kBuiltIn) {
    if (view == built_in.view) return built_in.tone;
  }
  return nullptr;
}

/// Null where there is no such view.
ocio::ConstCPUProcessorRcPtr Find(const std::string& view) {
  for (const BuiltIn& built_in : kBuiltIn) {
    if (view == built_in.view) return ProcessorOf(BuiltInConfig(), kLinear, kDisplay, view);
  }
  const ocio::ConstConfigRcPtr studio = StudioConfig();
  if (studio == nullptr) return nullptr;
  const std::vector<std::string> views = ViewsOf(studio);
  if (std::find(views.begin(), views.end(), view) == views.end()) return nullptr;
  const std::string first = studio->getDefaultDisplay();
  const size_t slash = view.find('/');
  const bool has_display =
      slash != std::string::npos && studio->getNumViews(view.substr(0, slash).c_str()) > 0;
  return ProcessorOf(studio, LinearSpaceOf(studio), has_display ? view.substr(0, slash) : first,
                     has_display ? view.substr(slash + 1) : view);
}

}  // namespace

struct ViewTransform::Processor {
  ocio::ConstCPUProcessorRcPtr cpu;
  void (*tone)(float rgb[3]) = nullptr;
};

ViewTransform::ViewTransform(std::unique_ptr<Processor> processor) : processor_(std::move(processor)) {}
ViewTransform::ViewTransform(ViewTransform&&) noexcept = default;
ViewTransform& ViewTransform::operator=(ViewTransform&&) noexcept = default;
ViewTransform::~ViewTransform() = default;

absl::StatusOr<ViewTransform> ViewTransform::Create(const std::string& view) {
  try {
    auto processor = std::make_unique<Processor>(Processor{Find(view), ToneOf(view)});
    if (processor->cpu != nullptr) return ViewTransform(std::move(processor));
    return absl::InvalidArgumentError(
        absl::StrCat("expected ", absl::StrJoin(Views(), ", "), "; got '", view, "'"));
  } catch (const ocio::Exception& error) {
    return absl::InvalidArgumentError(absl::StrCat("view '", view, "': ", error.what()));
  }
}

std::vector<std::string> ViewTransform::Views() {
  std::vector<std::string> views;
  views.reserve(kBuiltIn.size());
  for (const BuiltIn& built_in : kBuiltIn) views.emplace_back(built_in.view);
  try {
    if (const ocio::ConstConfigRcPtr studio = StudioConfig(); studio != nullptr) {
      for (std::string& view : ViewsOf(studio)) views.push_back(std::move(view));
    }
  } catch (const ocio::Exception&) {  // whoever asks for one of its views learns why
  }
  return views;
}

void ViewTransform::Apply(absl::Span<float> rgb) const {
  for (float& value : rgb) value = std::isnan(value) ? 0.0f : value;
  if (processor_->tone != nullptr) {
    for (size_t i = 0; i + 2 < rgb.size(); i += 3) processor_->tone(&rgb[i]);
  }
  ocio::PackedImageDesc pixels(rgb.data(), static_cast<long>(rgb.size() / 3), 1, 3);
  processor_->cpu->apply(pixels);
}

}  // namespace lumifold::pictures
