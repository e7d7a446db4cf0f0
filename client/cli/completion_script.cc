#include "client/cli/completion_script.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"

namespace lumifold::client {
namespace {

/// Text between single quotes of a shell.
std::string Quoted(const std::string& text) {
  return absl::StrCat("'", absl::StrReplaceAll(text, {{"'", "'\\''"}, {"\n", " "}}), "'");
}

/// What prints the words that a value may be, as a shell command; empty: they are not known.
std::string SourceOf(const OptionHelp& option) {
  if (!option.choices.empty()) return absl::StrCat("echo ", absl::StrJoin(option.choices, " "));
  if (option.value_name.starts_with("JOB"))
    return "lumifold list --limit 50 2>/dev/null | sed 1d | cut -d\" \" -f1; echo last";
  if (option.value_name == "WORKER") return "lumifold workers 2>/dev/null | sed 1d | cut -d\" \" -f1";
  return "";
}

/// Prints the names that `info` has behind a word, the first argument of the shell's function, a line each.
std::string NamesInScene(const char* argument) {
  return absl::StrCat("lumifold info \"$scene\" 2>/dev/null | sed -n \"s/^", argument,
                      " *//p\" | grep -o \"'[^']*'\" | tr -d \"'\"");
}

/// What `info` prints before the numbers and names of what a value chooses in a scene; empty: nothing of it.
std::string ChoiceInScene(const OptionHelp& option) {
  if (option.value_name == "CAMERA") return "cameras";
  if (option.value_name == "CLIP") return "animations";
  return option.value_name == "VARIANT" ? "variants" : "";
}

std::string NamesOf(const OptionHelp& option, const char* separator) {
  return absl::StrJoin(option.names, separator);
}

/// Cases of bash for the word before: options with a value.
std::string BashValues(const CommandHelp& command) {
  std::string cases;
  for (const OptionHelp& option : command.options) {
    if (option.is_argument() || option.is_flag()) continue;
    const std::string source = SourceOf(option);
    const std::string in_scene = ChoiceInScene(option);
    absl::StrAppend(&cases, "        ", NamesOf(option, "|"), ") ");
    if (OptionHelp::IsFile(option.value_name)) {
      absl::StrAppend(&cases, "options= ;;\n");
    } else if (!in_scene.empty()) {
      absl::StrAppend(&cases, "_lumifold_of_scene ", in_scene, "; return ;;\n");
    } else if (!source.empty()) {
      absl::StrAppend(&cases, "_lumifold_words ", Quoted(source), "; return ;;\n");
    } else {
      absl::StrAppend(&cases, "return ;;\n");
    }
  }
  return cases;
}

/// What of bash offers the words of a command's first argument, where they are no files.
std::string BashArgument(const CommandHelp& command) {
  for (const OptionHelp& option : command.options) {
    const std::string source = SourceOf(option);
    if (!option.is_argument() || source.empty()) continue;
    return absl::StrCat("      if [[ $word != -* ]]; then _lumifold_words ", Quoted(source),
                        "; return; fi\n");
  }
  return "";
}

/// In fish, which reads a word in each line; empty: the words are not known.
std::string FishWords(const OptionHelp& option) {
  if (const std::string in_scene = ChoiceInScene(option); !in_scene.empty())
    return absl::StrCat("(__lumifold_of_scene ", in_scene, ")");
  const std::string source = SourceOf(option);
  return source.empty() ? "" : absl::StrCat("(begin; ", source, "; end | string split \" \")");
}

/// "[text]" of zsh's _arguments.
std::string ZshText(const std::string& text) {
  return absl::StrReplaceAll(text, {{"[", "\\["}, {"]", "\\]"}, {":", "\\:"}, {"\n", " "}});
}

/// What of _arguments offers a value.
std::string ZshAction(const OptionHelp& option) {
  if (OptionHelp::IsFile(option.value_name)) return "_files";
  if (const std::string in_scene = ChoiceInScene(option); !in_scene.empty())
    return absl::StrCat(" _lumifold_of_scene ", in_scene);
  const std::string source = SourceOf(option);
  return source.empty() ? " " : absl::StrCat(" _lumifold_words ", Quoted(source));
}

std::string ZshSpec(const OptionHelp& option, const std::string& name) {
  const std::string value =
      option.is_flag() ? "" : absl::StrCat(":", ZshText(option.value_name), ":", ZshAction(option));
  if (option.is_argument()) return absl::StrCat(option.is_required ? "" : ":", value);
  return absl::StrCat("*", name, "[", ZshText(option.help), "]", value);
}

}  // namespace

std::string BashCompletion(const std::vector<CommandHelp>& commands) {
  std::string names;
  std::string cases;
  for (const CommandHelp& command : commands) {
    absl::StrAppend(&names, names.empty() ? "" : " ", command.name);
    std::string options;
    for (const OptionHelp& option : command.options)
      absl::StrAppend(&options, options.empty() || option.is_argument() ? "" : " ", NamesOf(option, " "));
    absl::StrAppend(&cases, "    ", command.name, ")\n      options=", Quoted(options), "\n");
    if (const std::string values = BashValues(command); !values.empty())
      absl::StrAppend(&cases, "      case $before in\n", values, "      esac\n");
    absl::StrAppend(&cases, BashArgument(command), "      ;;\n");
  }
  return absl::StrCat(
      "# Completion of lumifold for bash: source it, or put it into "
      "/usr/share/bash-completion/completions/lumifold.\n"
      "# Offers lines. compgen -W would expand them, and names of scenes and workers are others'.\n"
      "_lumifold_offer() {\n"
      "  local line\n"
      "  while IFS= read -r line; do\n"
      "    if [[ $line == \"$word\"* ]]; then COMPREPLY+=(\"$line\"); fi\n"
      "  done\n"
      "}\n"
      "_lumifold_words() { _lumifold_offer < <(eval \"$1\" | tr \" \" \"\\n\"); }\n"
      "# Names that a scene on the command line has: _lumifold_of_scene cameras\n"
      "_lumifold_of_scene() {\n"
      "  local scene\n"
      "  for scene in \"${COMP_WORDS[@]}\"; do\n"
      "    [[ $scene == *.gl[bt]* ]] || continue\n"
      "    _lumifold_offer < <(",
      NamesInScene("$1"),
      ")\n"
      "    return\n"
      "  done\n"
      "}\n"
      "_lumifold() {\n"
      "  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]} options=\n"
      "  COMPREPLY=()\n"
      "  if [ \"$COMP_CWORD\" -eq 1 ]; then\n"
      "    COMPREPLY=($(compgen -W ",
      Quoted(absl::StrCat(names, " --help --version")),
      " -- \"$word\"))\n"
      "    return\n"
      "  fi\n"
      "  case ${COMP_WORDS[1]} in\n",
      cases,
      "  esac\n"
      "  if [[ $word == -* && -n $options ]]; then\n"
      "    COMPREPLY=($(compgen -W \"$options\" -- \"$word\"))\n"
      "  else\n"
      "    local IFS=$'\\n'\n"
      "    COMPREPLY=($(compgen -f -- \"$word\"))\n"
      "  fi\n"
      "}\n"
      "complete -o filenames -F _lumifold lumifold\n");
}

std::string ZshCompletion(const std::vector<CommandHelp>& commands) {
  std::string list;
  std::string cases;
  for (const CommandHelp& command : commands) {
    absl::StrAppend(&list, "    ", Quoted(absl::StrCat(command.name, ":", ZshText(command.summary))), "\n");
    absl::StrAppend(&cases, "    ", command.name, ")\n      _arguments");
    for (const OptionHelp& option : command.options) {
      for (const std::string& name : option.names)
        absl::StrAppend(&cases, " \\\n        ", Quoted(ZshSpec(option, name)));
      if (option.is_argument()) absl::StrAppend(&cases, " \\\n        ", Quoted(ZshSpec(option, "")));
    }
    absl::StrAppend(&cases, "\n      ;;\n");
  }
  return absl::StrCat(
      "#compdef lumifold\n"
      "# Completion of lumifold for zsh: put it into a folder of $fpath, as _lumifold.\n"
      "_lumifold_words() { compadd -- ${=$(eval \"$1\")} }\n"
      "_lumifold_of_scene() {\n"
      "  local scene\n"
      "  for scene in ${(Q)words}; do\n"
      "    [[ $scene == *.gl[bt]* ]] || continue\n"
      "    compadd -- ${(f)\"$(",
      NamesInScene("$1"),
      ")\"}\n"
      "    return\n"
      "  done\n"
      "}\n"
      "local -a names\n"
      "names=(\n",
      list,
      ")\n"
      "if (( CURRENT == 2 )); then\n"
      "  _describe command names\n"
      "else\n"
      "  local command=$words[2]\n"
      "  shift words\n"
      "  (( CURRENT-- ))\n"
      "  case $command in\n",
      cases,
      "  esac\n"
      "fi\n");
}

std::string FishCompletion(const std::vector<CommandHelp>& commands) {
  std::string script = absl::StrCat(
      "# Completion of lumifold for fish: put it into ~/.config/fish/completions/lumifold.fish.\n"
      "function __lumifold_of_scene\n"
      "  for scene in (commandline -opc)\n"
      "    string match -qr '[.]gl(b|tf)$' -- $scene; or continue\n"
      "    ",
      NamesInScene("$argv[1]"),
      "\n"
      "    return\n"
      "  end\n"
      "end\n"
      "complete -c lumifold -n __fish_use_subcommand -f\n");
  for (const CommandHelp& command : commands) {
    absl::StrAppend(&script, "complete -c lumifold -n __fish_use_subcommand -f -a ", command.name, " -d ",
                    Quoted(command.summary), "\n");
    for (const OptionHelp& option : command.options) {
      const std::string words = FishWords(option);
      if (option.is_argument() && words.empty()) continue;
      absl::StrAppend(&script, "complete -c lumifold -n '__fish_seen_subcommand_from ", command.name, "'");
      if (!words.empty()) absl::StrAppend(&script, option.is_argument() ? " -fa " : " -a ", Quoted(words));
      for (const std::string& name : option.names)
        absl::StrAppend(&script, name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1));
      if (!option.value_name.empty())
        absl::StrAppend(&script, OptionHelp::IsFile(option.value_name) ? " -rF" : " -x");
      absl::StrAppend(&script, " -d ", Quoted(option.help), "\n");
    }
  }
  return script;
}

}  // namespace lumifold::client
