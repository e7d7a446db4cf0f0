#include "proto/service/help_style.h"

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"

namespace lumifold::service {
namespace {

constexpr size_t kColumn = 32;

/// The name of an option's value in help: that of the program, one of the words that it may be, or N or TEXT.
std::string ValueName(const CLI::Option& option) {
  if (!option.get_option_text().empty()) return option.get_option_text();
  const std::string type = option.get_type_name();  // "FLOAT:FLOAT in [0 - 1]", "TEXT:{a,b}"
  if (const size_t brace = type.find('{'); brace != std::string::npos)
    return absl::StrReplaceAll(type.substr(brace + 1, type.find('}') - brace - 1), {{",", "|"}});
  const std::string base = type.substr(0, type.find(':'));
  if (base == "INT" || base == "UINT" || base == "FLOAT") return "N";
  return base == "TEXT" || base == "FILE" ? base : type;
}

class HelpFormatter final : public CLI::Formatter {
 public:
  HelpFormatter() { column_width(kColumn); }

  std::string make_option_opts(const CLI::Option* option) const override {
    const std::string value = option->get_type_size() == 0 ? "" : absl::StrCat(" ", ValueName(*option));
    return absl::StrCat(value, option->get_required() ? " (required)" : "");
  }
  std::string make_option_desc(const CLI::Option* option) const override {
    std::string text = option->get_description();
    const std::string variable =
        option->get_envname().empty() ? "" : absl::StrCat("$", option->get_envname());
    const std::string value = option->get_default_str();
    if (absl::StrContains(text, "(default") || (variable.empty() && value.empty())) return text;
    const char* const between = variable.empty() || value.empty() ? "" : ", else ";
    return absl::StrCat(text, " (default ", variable, between, value, ")");
  }
};

}  // namespace

void SetHelpStyle(CLI::App* app) {
  app->formatter(std::make_shared<HelpFormatter>());
  app->set_help_flag("-h,--help", "Print this and exit");
}

}  // namespace lumifold::service
