#include "tests/charts/row.h"

#include <nlohmann/json.hpp>

namespace lumifold::charts {
namespace {

nlohmann::json OptionalJson(std::optional<double> value) {
  return value.has_value() ? nlohmann::json(*value) : nlohmann::json();
}

std::optional<double> OptionalFrom(const nlohmann::json& json) {
  return json.is_null() ? std::nullopt : std::optional(json.get<double>());
}

}  // namespace

std::string EncodeRow(const Row& row) {
  const nlohmann::json json = {{"scene", row.scene},
                               {"width", row.width},
                               {"height", row.height},
                               {"samples", row.samples},
                               {"method", row.method},
                               {"parameters", row.parameters},
                               {"is_default", row.is_default},
                               {"mse255", row.errors.mse255.whole},
                               {"of_region", row.errors.mse255.of_region},
                               {"share", row.errors.mse255.share},
                               {"rel_mse", row.errors.rel_mse},
                               {"ssim", OptionalJson(row.errors.ssim)},
                               {"flip", OptionalJson(row.errors.flip)},
                               {"render_seconds", row.render_seconds},
                               {"filter_seconds", row.filter_seconds}};
  return json.dump();
}

absl::StatusOr<Row> DecodeRow(std::string_view text) {
  try {  // the library throws
    const nlohmann::json json = nlohmann::json::parse(text);
    Row row;
    json.at("scene").get_to(row.scene);
    json.at("width").get_to(row.width);
    json.at("height").get_to(row.height);
    json.at("samples").get_to(row.samples);
    json.at("method").get_to(row.method);
    json.at("parameters").get_to(row.parameters);
    json.at("is_default").get_to(row.is_default);
    json.at("mse255").get_to(row.errors.mse255.whole);
    json.at("of_region").get_to(row.errors.mse255.of_region);
    json.at("share").get_to(row.errors.mse255.share);
    json.at("rel_mse").get_to(row.errors.rel_mse);
    row.errors.ssim = OptionalFrom(json.at("ssim"));
    row.errors.flip = OptionalFrom(json.at("flip"));
    json.at("render_seconds").get_to(row.render_seconds);
    json.at("filter_seconds").get_to(row.filter_seconds);
    return row;
  } catch (const nlohmann::json::exception& wrong) {
    return absl::DataLossError(wrong.what());
  }
}

}  // namespace lumifold::charts
