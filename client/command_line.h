#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/environment.h"
#include "client/frame_range.h"
#include "client/picture_size.h"

namespace lumifold::client {

/// The options and arguments of one subcommand. Values are written where the caller points once they have
/// been found valid; the caller's variables hold the defaults. `names` is as help shows it: "-o,--output".
class CommandLine {
 public:
  /// `command` as in "lumifold COMMAND"; `summary` is the first line of its help.
  CommandLine(const std::string& command, const std::string& summary);
  ~CommandLine();

  CommandLine(const CommandLine&) = delete;
  CommandLine& operator=(const CommandLine&) = delete;

  /// An argument by position, always required.
  void AddArgument(const std::string& name, std::string* value, const std::string& help);

  void AddFlag(const std::string& names, bool* value, const std::string& help);
  /// `value_name` is what help calls the value ("FILE").
  void AddText(const std::string& names, const std::string& value_name, std::string* value,
               const std::string& help);
  void AddRequiredText(const std::string& names, const std::string& value_name, std::string* value,
                       const std::string& help);
  /// A whole number from `least` to `most`.
  void AddWholeNumber(const std::string& names, int* value, int least, int most, const std::string& help);
  /// Any 64-bit unsigned number.
  void AddSeed(const std::string& names, uint64_t* value, const std::string& help);
  /// Any finite number.
  void AddNumber(const std::string& names, float* value, const std::string& help);
  /// A finite number above 0.
  void AddPositiveNumber(const std::string& names, float* value, const std::string& help);
  void AddSize(const std::string& names, PictureSize* value, const std::string& help);
  /// One frame or several.
  void AddFrames(const std::string& names, FrameRange* value, const std::string& help);

  /// HOST:PORT of a coordinator.
  void AddAddress(const std::string& names, std::string* value, const std::string& help);

  /// More words for help, between the options and the exit codes.
  void SetFooter(const std::string& text);

  /// Reads the arguments that follow the command's name. A value means that the program ends with it: help
  /// was asked for and printed on `out`, or one line on `err` has said what is wrong.
  std::optional<ExitCode> Parse(const std::vector<std::string>& arguments, const Environment& environment);

 private:
  class Parser;
  std::unique_ptr<Parser> parser_;
};

/// Says on `err` what is wrong with the command line and returns kUsage. `command` is "lumifold" or "lumifold
/// COMMAND".
ExitCode ReportUsage(const Environment& environment, const std::string& command, const std::string& message);

}  // namespace lumifold::client
