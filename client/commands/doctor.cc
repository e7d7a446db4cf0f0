#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "client/cli/option_file.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/reports/findings.h"
#include "proto/subprocess/run_command.h"

namespace lumifold::client {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kKibibyte = 1024;
constexpr size_t kMaxVersionBytes = 256;

/// Bytes of memory that programs can still get.
uint64_t AvailableMemory() {
  std::ifstream file("/proc/meminfo");
  std::string name;
  uint64_t kibibytes = 0;
  std::string rest;
  while (file >> name >> kibibytes && std::getline(file, rest)) {
    if (name == "MemAvailable:") return kibibytes * kKibibyte;
  }
  return 0;
}

MachineFacts FactsOfMachine() {
  MachineFacts facts;
  std::error_code error;
  const fs::path folder = fs::temp_directory_path(error);
  facts.temporary_folder = folder.string();
  std::string file = (folder / "lumifold-doctor-XXXXXX").string();
  const int descriptor = error ? -1 : mkstemp(file.data());
  if (descriptor >= 0) {
    close(descriptor);
    unlink(file.c_str());
  } else {
    facts.temporary_error =
        error ? error.message() : std::error_code(errno, std::generic_category()).message();
  }
  facts.free_bytes = fs::space(folder, error).available;
  facts.available_memory_bytes = AvailableMemory();
  rlimit limit = {};
  if (getrlimit(RLIMIT_NOFILE, &limit) == 0) facts.open_files = limit.rlim_cur;
  return facts;
}

/// The path of a program beside this one or on PATH; empty: it is not there.
std::string PathOfProgram(const std::string& name) {
  std::error_code ignored;
  std::vector<fs::path> folders = {fs::read_symlink("/proc/self/exe", ignored).parent_path()};
  const char* const path = std::getenv("PATH");
  for (const absl::string_view folder : absl::StrSplit(path == nullptr ? "" : path, ':', absl::SkipEmpty()))
    folders.emplace_back(std::string(folder));
  for (const fs::path& folder : folders) {
    const fs::path file = folder / name;
    if (access(file.c_str(), X_OK) == 0 && fs::is_regular_file(file, ignored)) return file.string();
  }
  return "";
}

/// What `NAME --version` prints.
absl::StatusOr<std::string> VersionOf(const std::string& name) {
  const std::string path = PathOfProgram(name);
  if (path.empty()) return absl::NotFoundError(absl::StrCat("there is no ", name));
  const absl::StatusOr<subprocess::CommandResult> done =
      subprocess::RunCommand({path, "--version"}, {}, absl::InfiniteDuration());
  if (!done.ok()) return done.status();
  const std::string text = absl::StrCat(done->out, done->err).substr(0, kMaxVersionBytes);
  const std::string line(absl::StripAsciiWhitespace(text));
  if (done->exit_code != 0) return absl::InternalError(absl::StrCat(path, ": ", line));
  return line;
}

Finding AboutConfiguration(const Environment& environment) {
  constexpr char kSubject[] = "configuration";
  std::error_code ignored;
  if (!fs::exists(environment.configuration.path, ignored))
    return {Finding::Level::kOk, kSubject, absl::StrCat("there is no ", environment.configuration.path)};
  const absl::StatusOr<OptionFile> file = ReadConfiguration(environment);
  if (file.ok()) return {Finding::Level::kOk, kSubject, environment.configuration.path};
  return {Finding::Level::kWrong, kSubject, std::string(file.status().message()),
          "correct or remove that line"};
}

absl::StatusOr<absl::Time> ExpiryOf(const identity::Profiles& profiles, const std::string& name) {
  const absl::StatusOr<identity::Profile> profile = profiles.Read(name);
  if (!profile.ok()) return profile.status();
  if (!profile->has_certificate) return absl::InfiniteFuture();
  const absl::StatusOr<identity::CertificateFacts> facts = profiles.CertificateOf(name);
  if (!facts.ok()) return facts.status();
  return facts->not_after;
}

absl::StatusOr<std::vector<v1::WorkerStatus>> WorkersOf(FarmClient& farm) {
  std::vector<v1::WorkerStatus> workers;
  v1::ListWorkersRequest request;
  do {
    const absl::StatusOr<v1::ListWorkersResponse> page = farm.ListWorkers(request);
    if (!page.ok()) return page.status();
    workers.insert(workers.end(), page->workers().begin(), page->workers().end());
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty());
  return workers;
}

/// Asks and reports one thing after the other, so that the user sees what takes time.
class Doctor {
 public:
  Doctor(const Environment& environment, RemoteOptions* remote)
      : environment_(environment), remote_(*remote) {}

  ExitCode Run() {
    ReportAll(AboutMachine(FactsOfMachine()));
    for (const char* program : {"lumifold-server", "lumifold-worker"})
      Report(AboutProgram(program, VersionOf(program)));
    if (environment_.local.devices) ReportAll(AboutDevices(environment_.local.devices()));
    Report(AboutConfiguration(environment_));
    for (const std::string& name : remote_.profiles.List())
      Report(AboutProfile(name, ExpiryOf(remote_.profiles, name), identity::ValidityClock()));
    LookAtFarm();
    if (!remote_.json) environment_.out << (is_wrong_ ? "" : "nothing is wrong\n") << std::flush;
    return is_wrong_ ? ExitCode::kFailed : ExitCode::kOk;
  }

 private:
  void LookAtFarm() {
    const bool is_named =
        !remote_.server.empty() || !remote_.profile.empty() || !remote_.profiles.List().empty();
    if (const absl::Status status = remote_.Resolve(); !status.ok())
      return Report({Finding::Level::kWrong, "farm", std::string(status.message()),
                     "lumifold login, or --server and --profile"});
    bool answers = false;
    for (const std::string& address : remote_.coordinators()) {
      const absl::StatusOr<v1::ServerStatus> status =
          remote_.ConnectTo(address, environment_)->GetServerStatus();
      answers = answers || status.ok();
      ReportAll(AboutCoordinator(address, is_named, status));
    }
    if (!answers) return;
    Report(AboutIdentity(remote_.ConnectToAccess(environment_)->WhoAmI()));
    ReportAll(AboutWorkers(WorkersOf(*remote_.Connect(environment_))));
  }

  void Report(const Finding& finding) {
    is_wrong_ = is_wrong_ || finding.level == Finding::Level::kWrong;
    environment_.out << (remote_.json ? FindingJson(finding) + "\n"
                                      : FindingText(finding, environment_.terminal.out_has_colours))
                     << std::flush;
  }
  void ReportAll(const Findings& findings) {
    for (const Finding& finding : findings) Report(finding);
  }

  const Environment& environment_;
  RemoteOptions& remote_;
  bool is_wrong_ = false;
};

}  // namespace

ExitCode RunDoctor(const std::vector<std::string>& arguments, const Environment& environment) {
  RemoteOptions remote(environment);
  CommandLine command_line(WordsOf("doctor"));
  remote.AddOptions(command_line);
  command_line.SetFooter("The exit code is 1 if something is wrong.");
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  return Doctor(environment, &remote).Run();
}

}  // namespace lumifold::client
