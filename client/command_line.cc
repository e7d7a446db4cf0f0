#include "client/command_line.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "client/suggestion.h"
#include "proto/rpc/endpoints.h"

namespace lumifold::client {
namespace {

constexpr size_t kHelpColumn = 26;

// Parses one value. Returns the expected format for invalid text, and an empty string for valid text.
using ReadValue = std::function<std::string(const std::string& text)>;
// The same for the values of all uses of an option.
using ReadValues = std::function<std::string(const std::vector<std::string>& texts)>;

bool IsDigits(const std::string& text) {
  return !text.empty() &&
         std::all_of(text.begin(), text.end(), [](unsigned char c) { return absl::ascii_isdigit(c); });
}

ReadValue ReadWholeNumber(int* value, int least, int most) {
  return [=](const std::string& text) -> std::string {
    int number = 0;
    const bool is_negative = least < 0 && text.starts_with('-');
    if (!IsDigits(text.substr(is_negative ? 1 : 0)) || !absl::SimpleAtoi(text, &number) || number < least ||
        number > most) {
      return absl::StrCat("expected a whole number from ", least, " to ", most, "; got '", text, "'");
    }
    *value = number;
    return "";
  };
}

std::string FirstLine(const std::string& text) { return text.substr(0, text.find('\n')); }

}  // namespace

// All use of CLI11; its exceptions are caught in Parse.
class CommandLine::Parser {
 public:
  Parser(const std::string& command, const std::string& summary) : app_(summary, "lumifold " + command) {
    app_.get_formatter()->column_width(kHelpColumn);
    app_.get_formatter()->label("REQUIRED", "(required)");
    app_.footer(kExitCodesHelp);
    app_.set_help_flag("-h,--help", "Print this and exit");
    app_.allow_extras();  // so that Parse can name them with a suggestion
  }

  CLI::Option* Add(const std::string& names, const std::string& value_name, ReadValue read,
                   const std::string& help) {
    const ReadValues read_last = [read = std::move(read)](const std::vector<std::string>& texts) {
      return read(texts.back());
    };
    return AddRepeated(names, value_name, read_last, help)
        ->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
  }

  CLI::Option* AddRepeated(const std::string& names, const std::string& value_name, ReadValues read,
                           const std::string& help) {
    const std::string long_name = names.substr(names.rfind(',') + 1);  // the whole text if there is no comma
    CLI::callback_t store = [read = std::move(read), long_name](const CLI::results_t& texts) {
      const std::string problem = read(texts);
      if (!problem.empty()) throw CLI::ValidationError(long_name, problem);
      return true;
    };
    return app_.add_option(names, std::move(store), help)
        ->type_name(value_name)
        ->allow_extra_args(false)
        ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  }

  CLI::App& app() { return app_; }

  // Error message about the first unknown argument; empty if there is none.
  std::string UnknownArgument() const {
    const std::vector<std::string> extras = app_.remaining();
    const auto option = std::find_if(extras.begin(), extras.end(), [](const std::string& text) {
      return text.size() > 1 && text.front() == '-' && text != "--";
    });
    if (option != extras.end()) {
      const std::string name = option->substr(0, option->find('='));
      return absl::StrCat("unknown option ", name, Suggestion(name, OptionNames()));
    }
    return extras.empty() ? "" : absl::StrCat("unexpected argument '", extras.front(), "'");
  }

 private:
  std::vector<std::string> OptionNames() const {
    std::vector<std::string> names;
    for (const CLI::Option* option : app_.get_options()) {
      for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    }
    return names;
  }

  CLI::App app_;
};

CommandLine::CommandLine(const std::string& command, const std::string& summary)
    : parser_(std::make_unique<Parser>(command, summary)) {}

CommandLine::~CommandLine() = default;

void CommandLine::AddArgument(const std::string& name, std::string* value, const std::string& help) {
  AddRequiredText(name, "", value, help);
}

void CommandLine::AddOptionalArgument(const std::string& name, std::string* value, const std::string& help) {
  AddText(name, "", value, help);
}

void CommandLine::AddFlag(const std::string& names, bool* value, const std::string& help) {
  parser_->app().add_flag(names, *value, help)->disable_flag_override();
}

void CommandLine::AddText(const std::string& names, const std::string& value_name, std::string* value,
                          const std::string& help) {
  const ReadValue read = [value](const std::string& text) -> std::string {
    if (text.empty()) return "expected a non-empty text";
    *value = text;
    return "";
  };
  parser_->Add(names, value_name, read, help);
}

void CommandLine::AddRequiredText(const std::string& names, const std::string& value_name, std::string* value,
                                  const std::string& help) {
  AddText(names, value_name, value, help);
  parser_->app().get_options().back()->required();
}

void CommandLine::AddTexts(const std::string& names, const std::string& value_name,
                           std::vector<std::string>* values, const std::string& help) {
  const ReadValues read = [values](const std::vector<std::string>& texts) -> std::string {
    std::vector<std::string> words;
    for (const std::string& text : texts) {
      for (const absl::string_view word : absl::StrSplit(text, ',')) words.emplace_back(word);
    }
    if (std::count(words.begin(), words.end(), "") > 0) return "expected a non-empty text";
    *values = std::move(words);
    return "";
  };
  parser_->AddRepeated(names, value_name, read, help);
}

void CommandLine::AddWholeNumber(const std::string& names, int* value, int least, int most,
                                 const std::string& help) {
  parser_->Add(names, "N", ReadWholeNumber(value, least, most), help);
}

void CommandLine::AddWholeNumberArgument(const std::string& name, int* value, int least, int most,
                                         const std::string& help) {
  parser_->Add(name, "", ReadWholeNumber(value, least, most), help)->required();
}

void CommandLine::AddSeed(const std::string& names, uint64_t* value, const std::string& help) {
  const ReadValue read = [value](const std::string& text) -> std::string {
    if (!IsDigits(text) || !absl::SimpleAtoi(text, value)) {
      return absl::StrCat("expected a whole number from 0 to 18446744073709551615; got '", text, "'");
    }
    return "";
  };
  parser_->Add(names, "N", read, help);
}

void CommandLine::AddNumber(const std::string& names, float* value, const std::string& help) {
  const ReadValue read = [value](const std::string& text) -> std::string {
    float number = 0;
    if (!absl::SimpleAtof(text, &number) || !std::isfinite(number)) {
      return absl::StrCat("expected a number; got '", text, "'");
    }
    *value = number;
    return "";
  };
  parser_->Add(names, "X", read, help);
}

void CommandLine::AddShare(const std::string& names, float* value, const std::string& help) {
  const ReadValue read = [value](const std::string& text) -> std::string {
    float number = 0;
    if (!absl::SimpleAtof(text, &number) || !(number >= 0 && number <= 1)) {
      return absl::StrCat("expected a number from 0 to 1; got '", text, "'");
    }
    *value = number;
    return "";
  };
  parser_->Add(names, "X", read, help);
}

void CommandLine::AddPositiveNumber(const std::string& names, float* value, const std::string& help) {
  const ReadValue read = [value](const std::string& text) -> std::string {
    float number = 0;
    if (!absl::SimpleAtof(text, &number) || !std::isfinite(number) || number <= 0) {
      return absl::StrCat("expected a number above 0; got '", text, "'");
    }
    *value = number;
    return "";
  };
  parser_->Add(names, "X", read, help);
}

void CommandLine::AddSize(const std::string& names, PictureSize* value, const std::string& help) {
  const ReadValue read = [value](const std::string& text) -> std::string {
    const absl::StatusOr<PictureSize> size = ParsePictureSize(text);
    if (!size.ok()) return std::string(size.status().message());
    *value = *size;
    return "";
  };
  parser_->Add(names, "WxH", read, help);
}

void CommandLine::AddFrames(const std::string& names, Frames* value, const std::string& help) {
  const ReadValue read = [value](const std::string& text) -> std::string {
    const absl::StatusOr<Frames> frames = ParseFrames(text);
    if (!frames.ok()) return std::string(frames.status().message());
    *value = *frames;
    return "";
  };
  parser_->Add(names, "N[-LAST],...", read, help);
}

void CommandLine::AddAddresses(const std::string& names, std::string* value, const std::string& help) {
  const ReadValue read = [value](const std::string& text) -> std::string {
    if (const auto addresses = rpc::ParseEndpoints(text); !addresses.ok())
      return std::string(addresses.status().message());
    *value = text;
    return "";
  };
  parser_->Add(names, "HOST:PORT,...", read, help);
}

void CommandLine::AddCheck(std::function<absl::Status()> check) { checks_.push_back(std::move(check)); }

void CommandLine::SetFooter(const std::string& text) {
  parser_->app().footer(absl::StrCat(text, "\n", kExitCodesHelp));
}

std::optional<ExitCode> CommandLine::Parse(const std::vector<std::string>& arguments,
                                           const Environment& environment) {
  CLI::App& app = parser_->app();
  std::string problem;
  try {
    app.parse(std::vector<std::string>(arguments.rbegin(),
                                       arguments.rend()));  // CLI11 expects them in reverse order
  } catch (const CLI::CallForHelp&) {
    environment.out << app.help() << std::flush;
    return ExitCode::kOk;
  } catch (const CLI::ArgumentMismatch& error) {
    const std::string text = error.what();  // "--spp: 1 required N missing"
    problem = absl::StrCat(text.substr(0, text.find(':')), " needs a value");
  } catch (const CLI::ParseError& error) {
    problem = FirstLine(error.what());
  }
  // An unknown option may be the reason why CLI11 misses another one, so it is reported first.
  if (const std::string unknown = parser_->UnknownArgument(); !unknown.empty()) problem = unknown;
  if (!problem.empty()) return ReportUsage(environment, app.get_name(), problem);
  for (const std::function<absl::Status()>& check : checks_) {
    if (const absl::Status status = check(); !status.ok()) return ReportError(environment, status);
  }
  return std::nullopt;
}

ExitCode ReportUsage(const Environment& environment, const std::string& command, const std::string& message) {
  environment.err << command << ": " << message << "\n"
                  << "Try '" << command << " --help'.\n"
                  << std::flush;
  return ExitCode::kUsage;
}

}  // namespace lumifold::client
