#include "client/cli/command_line.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/cli/command_help.h"
#include "client/cli/option_file.h"
#include "client/cli/suggestion.h"
#include "proto/rpc/endpoints.h"
#include "proto/rpc/rect_codec.h"

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

constexpr char kJobOption[] = "--job";
constexpr char kProfileOption[] = "--profile";
constexpr char kServer[] = "server";

// Options of a file, or of a profile in it. One without values is set elsewhere.
struct OptionSource {
  const std::string* path;
  const FileOptions* options;
};

std::string FirstLine(const std::string& text) { return text.substr(0, text.find('\n')); }

}  // namespace

// All use of CLI11; its exceptions are caught in Parse.
class CommandLine::Parser {
 public:
  explicit Parser(const CommandWords& words)
      : app_(words.summary, "lumifold " + words.name),
        example_(words.example.empty() ? "" : absl::StrCat("Example: lumifold ", words.example, "\n")) {
    app_.get_formatter()->column_width(kHelpColumn);
    app_.get_formatter()->label("REQUIRED", "(required)");
    SetFooter("");
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

  void Offer(const std::string& name, std::function<std::vector<std::string>()> words) {
    offers_[app_.get_option(name)] = std::move(words);
  }

  void SetFooter(const std::string& text) {
    app_.footer(absl::StrCat(example_, text, text.empty() ? "" : "\n", kExitCodesHelp));
  }

  CommandHelp Description() const {
    CommandHelp command = {.name = app_.get_name().substr(app_.get_name().rfind(' ') + 1),
                           .summary = app_.get_description(),
                           .options = {},
                           .footer = app_.get_footer()};
    for (const CLI::Option* option : app_.get_options()) {
      OptionHelp& help = command.options.emplace_back();
      for (const std::string& name : option->get_snames()) help.names.push_back("-" + name);
      for (const std::string& name : option->get_lnames()) help.names.push_back("--" + name);
      help.value_name = ValueNameOf(*option);
      help.help = option->get_description();
      help.is_required = option->get_required();
      help.is_repeatable = IsRepeatable(*option);
      if (const auto offer = offers_.find(option); offer != offers_.end()) help.choices = offer->second();
    }
    return command;
  }

  // `arguments` preceded by the options of files that they do not have themselves. `sources`: the first one
  // that has an option counts.
  absl::StatusOr<std::vector<std::string>> Completed(const std::vector<std::string>& arguments,
                                                     const std::vector<OptionSource>& sources) {
    const Given given = FindGiven(arguments);
    std::set<const CLI::Option*> known = given.options;
    std::vector<std::string> options;
    for (const OptionSource& source : sources) {
      for (const FileOption& setting : *source.options) {
        const std::string place = absl::StrCat(*source.path, ":", setting.line);
        CLI::Option* const option = FindOption(setting.name);
        if (option == nullptr || !known.insert(option).second || setting.values.empty()) continue;
        places_[option] = place;
        absl::Status added = AddSetting(setting, *option, *source.path, &options);
        if (!added.ok()) return absl::InvalidArgumentError(absl::StrCat(place, ": ", added.message()));
      }
    }
    options.insert(options.end(), arguments.begin(), arguments.end());
    size_t place = 0;
    for (const CLI::Option* argument :
         app_.get_options([](const CLI::Option* o) { return o->get_positional(); })) {
      const auto found = arguments_of_files_.find(argument);
      if (place++ >= given.arguments && found != arguments_of_files_.end()) options.push_back(found->second);
    }
    return options;
  }

  // The last value that `arguments` give an option; empty if there is none.
  std::string ValueGiven(const std::string& option, const std::vector<std::string>& arguments) const {
    const Given given = FindGiven(arguments);
    const auto value = given.values.find(app_.get_option_no_throw(option));
    return value == given.values.end() ? "" : value->second;
  }

  // `problem` with the place of the option in a file that it is about.
  std::string WithPlace(const std::string& problem) const {
    const CLI::Option* const option = app_.get_option_no_throw(problem.substr(0, problem.find(':')));
    const auto place = places_.find(option);
    return place == places_.end() ? problem : absl::StrCat(place->second, ": ", problem);
  }

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
  // What the words of a command line set.
  struct Given {
    std::set<const CLI::Option*> options;
    std::map<const CLI::Option*, std::string> values;  // the last ones
    size_t arguments = 0;
  };

  static bool IsFlag(const CLI::Option& option) {
    return !option.get_positional() && option.get_type_name().empty();
  }
  static bool IsRepeatable(const CLI::Option& option) {
    return option.get_multi_option_policy() == CLI::MultiOptionPolicy::TakeAll;
  }
  static std::string ValueNameOf(const CLI::Option& option) {
    return option.get_positional() ? option.get_name() : option.get_type_name();
  }

  Given FindGiven(const std::vector<std::string>& arguments) const {
    Given given;
    for (size_t i = 0; i < arguments.size(); ++i) {
      const std::string& word = arguments[i];
      const bool is_long = word.starts_with("--");
      const size_t end = is_long ? word.find('=') : 2;
      const CLI::Option* const option =
          word.starts_with('-') ? app_.get_option_no_throw(word.substr(0, end)) : nullptr;
      if (option == nullptr) {
        if (word == "--") return given.arguments += arguments.size() - i - 1, given;
        ++given.arguments;
        continue;
      }
      given.options.insert(option);
      if (IsFlag(*option)) continue;
      if (is_long ? end != std::string::npos : word.size() > end) {
        given.values[option] = word.substr(end + (is_long ? 1 : 0));
      } else if (++i < arguments.size()) {
        given.values[option] = arguments[i];
      }
    }
    return given;
  }

  // The option, or the argument, of a name in a file; null: there is none.
  CLI::Option* FindOption(const std::string& name) {
    for (CLI::Option* option : app_.get_options()) {
      if (option->get_positional() ? absl::AsciiStrToLower(option->get_name()) == name
                                   : option->check_lname(name))
        return option;
    }
    return nullptr;
  }

  bool IsOffered(const CLI::Option& option, const std::string& value) const {
    const auto offer = offers_.find(&option);
    if (offer == offers_.end()) return false;
    const std::vector<std::string> words = offer->second();
    return std::find(words.begin(), words.end(), value) != words.end();
  }

  // Adds a setting of a file as words of the command line.
  absl::Status AddSetting(const FileOption& setting, const CLI::Option& option, const std::string& path,
                          std::vector<std::string>* words) {
    if (IsFlag(option)) {
      bool value = false;
      if (setting.values.size() != 1 || !absl::SimpleAtob(setting.values[0], &value))
        return absl::InvalidArgumentError(absl::StrCat(setting.name, ": expected true or false"));
      if (value) words->push_back("--" + setting.name);
      return absl::OkStatus();
    }
    std::vector<std::string> values = setting.values;
    if (OptionHelp::IsFile(ValueNameOf(option))) {
      for (std::string& value : values) {
        if (IsOffered(option, value)) continue;  // no file
        value = (std::filesystem::path(path).parent_path() / value).lexically_normal().string();
      }
    }
    if (!IsRepeatable(option)) values = {absl::StrJoin(values, ",")};
    if (option.get_positional()) {
      arguments_of_files_[&option] = values[0];
      return absl::OkStatus();
    }
    for (const std::string& value : values) words->push_back(absl::StrCat("--", setting.name, "=", value));
    return absl::OkStatus();
  }

  std::vector<std::string> OptionNames() const {
    std::vector<std::string> names;
    for (const CLI::Option* option : app_.get_options()) {
      for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    }
    return names;
  }

  CLI::App app_;
  const std::string example_;
  std::map<const CLI::Option*, std::function<std::vector<std::string>()>> offers_;
  std::map<const CLI::Option*, std::string> arguments_of_files_;
  std::map<const CLI::Option*, std::string> places_;  // FILE:LINE of the options that come from files
};

CommandLine::CommandLine(const CommandWords& words) : parser_(std::make_unique<Parser>(words)) {}

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

void CommandLine::AddExposure(const std::string& names, std::optional<float>* value,
                              const std::string& help) {
  const ReadValue read = [value](const std::string& text) -> std::string {
    value->reset();
    if (text == "auto") return "";
    float number = 0;
    if (!absl::SimpleAtof(text, &number) || !std::isfinite(number) || number <= 0)
      return absl::StrCat("expected a number above 0 or 'auto'; got '", text, "'");
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
  parser_->Add(names, "W[xH]", read, help);
}

void CommandLine::AddRect(const std::string& names, std::optional<Rect>* value, const std::string& help) {
  const ReadValue read = [value](const std::string& text) -> std::string {
    *value = rpc::ParseRect(text);
    return value->has_value()
               ? ""
               : absl::StrCat("expected X0,Y0,X1,Y1, X0 below X1 and Y0 below Y1; got '", text, "'");
  };
  parser_->Add(names, "X0,Y0,X1,Y1", read, help);
}

void CommandLine::AddChoice(const std::string& names, const std::string& value_name,
                            const std::vector<std::string>& words, std::string* value,
                            const std::string& help) {
  const ReadValue read = [words, value](const std::string& text) -> std::string {
    *value = text;
    if (std::find(words.begin(), words.end(), text) != words.end()) return "";
    return absl::StrCat("expected ", absl::StrJoin(words, ", "), "; got '", text, "'",
                        Suggestion(text, words));
  };
  parser_->Add(names, value_name, read, help);
  Offer(names.substr(names.rfind(',') + 1), [words] { return words; });
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

void CommandLine::Offer(const std::string& name, std::function<std::vector<std::string>()> words) {
  parser_->Offer(name, std::move(words));
}

void CommandLine::AddCheck(std::function<absl::Status()> check) { checks_.push_back(std::move(check)); }

void CommandLine::SetFooter(const std::string& text) { parser_->SetFooter(text); }

absl::StatusOr<std::vector<std::string>> CommandLine::Complete(const std::vector<std::string>& arguments,
                                                               const Environment& environment) {
  std::vector<OptionSource> sources;
  OptionFile job;
  if (const std::string path = parser_->ValueGiven(kJobOption, arguments); !path.empty()) {
    absl::StatusOr<OptionFile> read = ReadOptionFile(path, OptionFileKind::kJob);
    if (!read.ok()) return read.status();
    job = *std::move(read);
    if (absl::Status status = CheckNames(job.path, job.options, environment.configuration.known_options);
        !status.ok())
      return status;
    sources.push_back({&job.path, &job.options});
  }
  const FileOptions variables = {{kServer, {}, 0}};
  if (!environment.defaults.server.empty()) sources.push_back({&job.path, &variables});
  if (const OptionFile* const configuration = environment.configuration.file; configuration != nullptr) {
    std::string profile = parser_->ValueGiven(kProfileOption, arguments);
    if (profile.empty()) profile = environment.defaults.profile;
    for (const FileOption& option : configuration->options) {
      if (profile.empty() && option.name == kProfileOption + 2) profile = option.values.front();
    }
    const auto chosen = configuration->profiles.find(profile);
    if (chosen != configuration->profiles.end()) sources.push_back({&configuration->path, &chosen->second});
    sources.push_back({&configuration->path, &configuration->options});
  }
  return parser_->Completed(arguments, sources);
}

std::optional<ExitCode> CommandLine::Parse(const std::vector<std::string>& arguments,
                                           const Environment& environment) {
  CLI::App& app = parser_->app();
  if (environment.description != nullptr) {
    *environment.description = parser_->Description();
    return ExitCode::kOk;
  }
  const absl::StatusOr<std::vector<std::string>> words = Complete(arguments, environment);
  if (absl::IsInvalidArgument(words.status()))
    return ReportUsage(environment, app.get_name(), std::string(words.status().message()));
  if (!words.ok()) return ReportError(environment, words.status());
  std::string problem;
  try {
    app.parse(
        std::vector<std::string>(words->rbegin(), words->rend()));  // CLI11 expects them in reverse order
  } catch (const CLI::CallForHelp&) {
    environment.out << app.help() << std::flush;
    return ExitCode::kOk;
  } catch (const CLI::ArgumentMismatch& error) {
    const std::string text = error.what();  // "--spp: 1 required N missing"
    problem = absl::StrCat(text.substr(0, text.find(':')), " needs a value");
  } catch (const CLI::ParseError& error) {
    problem = parser_->WithPlace(FirstLine(error.what()));
  }
  // An unknown option may be the reason why CLI11 misses another one, so it is reported first.
  if (const std::string unknown = parser_->UnknownArgument(); !unknown.empty()) problem = unknown;
  if (!problem.empty()) return ReportUsage(environment, app.get_name(), problem);
  for (const std::function<absl::Status()>& check : checks_) {
    if (const absl::Status status = check(); !status.ok()) return ReportError(environment, status);
  }
  return std::nullopt;
}

absl::Status CheckNames(const std::string& path, const FileOptions& options,
                        const std::vector<std::string>& known) {
  for (const FileOption& option : options) {
    if (known.empty() || std::find(known.begin(), known.end(), option.name) != known.end()) continue;
    return absl::InvalidArgumentError(absl::StrCat(path, ":", option.line, ": unknown option ", option.name,
                                                   Suggestion(option.name, known)));
  }
  return absl::OkStatus();
}

ExitCode ReportUsage(const Environment& environment, const std::string& command, const std::string& message) {
  environment.err << command << ": " << message << "\n"
                  << "Try '" << command << " --help'.\n"
                  << std::flush;
  return ExitCode::kUsage;
}

}  // namespace lumifold::client
