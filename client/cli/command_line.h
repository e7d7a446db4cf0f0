#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/cli/command_help.h"
#include "client/cli/environment.h"
#include "client/cli/frame_range.h"
#include "client/cli/option_file.h"
#include "client/cli/picture_size.h"
#include "filter/image/rect.h"

namespace lumifold::client {

/// The options and arguments of one subcommand. Valid values are written to the caller's variables, which
/// hold the defaults before. `names` has the form shown by help: "-o,--output".
class CommandLine {
 public:
  explicit CommandLine(const CommandWords& words);
  ~CommandLine();

  CommandLine(const CommandLine&) = delete;
  CommandLine& operator=(const CommandLine&) = delete;

  /// An optional positional argument.
  void AddOptionalArgument(const std::string& name, std::string* value, const std::string& help);
  /// A required positional argument.
  void AddArgument(const std::string& name, std::string* value, const std::string& help);

  void AddFlag(const std::string& names, bool* value, const std::string& help);
  /// `value_name` is the name of the value in help ("FILE").
  void AddText(const std::string& names, const std::string& value_name, std::string* value,
               const std::string& help);
  void AddRequiredText(const std::string& names, const std::string& value_name, std::string* value,
                       const std::string& help);
  /// Each use adds a value, and each value may be a list: "a,b".
  void AddTexts(const std::string& names, const std::string& value_name, std::vector<std::string>* values,
                const std::string& help);
  /// A whole number from `least` to `most`.
  void AddWholeNumber(const std::string& names, int* value, int least, int most, const std::string& help);
  /// The same as a required positional argument.
  void AddWholeNumberArgument(const std::string& name, int* value, int least, int most,
                              const std::string& help);
  /// Any 64-bit unsigned number.
  void AddSeed(const std::string& names, uint64_t* value, const std::string& help);
  /// Any finite number.
  void AddNumber(const std::string& names, float* value, const std::string& help);
  /// A number from 0 to 1.
  void AddShare(const std::string& names, float* value, const std::string& help);
  /// A finite number above 0.
  void AddPositiveNumber(const std::string& names, float* value, const std::string& help);
  /// A finite number above 0, or "auto", which is nothing.
  void AddExposure(const std::string& names, std::optional<float>* value, const std::string& help);
  void AddSize(const std::string& names, PictureSize* value, const std::string& help);
  /// A rectangle of pixels, X0,Y0,X1,Y1.
  void AddRect(const std::string& names, std::optional<Rect>* value, const std::string& help);
  /// One of `words`.
  void AddChoice(const std::string& names, const std::string& value_name,
                 const std::vector<std::string>& words, std::string* value, const std::string& help);
  /// A range of frames.
  void AddFrames(const std::string& names, Frames* value, const std::string& help);

  /// HOST:PORT of a coordinator, or a list of those of a farm: see rpc::ParseEndpoints.
  void AddAddresses(const std::string& names, std::string* value, const std::string& help);

  /// Completion offers these words for an option: "--view". Of an option that takes a file they are none.
  void Offer(const std::string& name, std::function<std::vector<std::string>()> words);

  /// `check` is called when all arguments are valid. Its error ends the command.
  void AddCheck(std::function<absl::Status()> check);

  /// Additional text of help, between the options and the exit codes.
  void SetFooter(const std::string& text);

  /// Parses the arguments after the command's name. Options that they do not have are those of the file of
  /// `--job`, where the command has that option, and of environment.configuration: of the profile, then of
  /// all. If it returns a value, the program ends with it: help was printed to `out`, or an error to `err`.
  std::optional<ExitCode> Parse(const std::vector<std::string>& arguments, const Environment& environment);

 private:
  absl::StatusOr<std::vector<std::string>> Complete(const std::vector<std::string>& arguments,
                                                    const Environment& environment);

  class Parser;
  std::unique_ptr<Parser> parser_;
  std::vector<std::function<absl::Status()>> checks_;
};

/// Errors: kInvalidArgument with place and suggestion for an option that is none of `known`, unless that is
/// empty.
absl::Status CheckNames(const std::string& path, const FileOptions& options,
                        const std::vector<std::string>& known);

/// Prints an error of the command line to `err` and returns kUsage. `command` is "lumifold" or "lumifold
/// COMMAND".
ExitCode ReportUsage(const Environment& environment, const std::string& command, const std::string& message);

}  // namespace lumifold::client
