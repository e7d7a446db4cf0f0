#include "proto/sandbox/sandbox.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <gmock/gmock.h>
#include <grp.h>
#include <gtest/gtest.h>
#include <netdb.h>
#include <pwd.h>
#include <sched.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "proto/sandbox/landlock.h"
#include "tests/support/temp_folder.h"

namespace lumifold::sandbox {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::HasSubstr;

/// What is tried; returns 0, or the error number.
using Attempt = std::function<int()>;

int ErrorOf(long result) { return result >= 0 ? 0 : errno; }

constexpr int kNoSandbox = 200;

/// The result of an attempt in a process of its own, inside the sandbox or, without options, outside.
int Try(const SandboxOptions* options, const Attempt& attempt) {
  const pid_t child = fork();
  if (child == 0) {
    if (options != nullptr && !EnterSandbox(*options).ok()) _exit(kNoSandbox);
    _exit(attempt());
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

int OpenAndClose(const std::string& path, int flags) {
  const int file = open(path.c_str(), flags | O_CLOEXEC, 0600);
  if (file < 0) return errno;
  close(file);
  return 0;
}

int Connect(uint16_t port) {
  const int file = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (file < 0) return errno;
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return ErrorOf(connect(file, reinterpret_cast<const sockaddr*>(&address), sizeof(address)));
}

int Listen() {
  const int file = socket(AF_INET, SOCK_STREAM, 0);
  return file < 0 ? errno : ErrorOf(listen(file, 1));
}

/// A port of this machine that accepts connections.
class Listener {
 public:
  Listener() : file_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(bind(file_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
    EXPECT_EQ(listen(file_, 8), 0);
    socklen_t size = sizeof(address);
    EXPECT_EQ(getsockname(file_, reinterpret_cast<sockaddr*>(&address), &size), 0);
    port_ = ntohs(address.sin_port);
  }
  ~Listener() { close(file_); }
  uint16_t port() const { return port_; }
  /// Accepts a connection from this process.
  int Accept() const {
    const int error = Connect(port_);
    return error != 0 ? error : ErrorOf(accept4(file_, nullptr, nullptr, SOCK_CLOEXEC));
  }

 private:
  int file_;
  uint16_t port_ = 0;
};

class SandboxTest : public testing::Test {
 protected:
  SandboxTest() {
    std::string name = (fs::temp_directory_path() / "lumifold-sandbox-XXXXXX").string();
    EXPECT_NE(mkdtemp(name.data()), nullptr);
    root_ = name;
    for (const char* folder : {"own", "other"}) {
      fs::create_directory(root_ / folder);
      std::ofstream(root_ / folder / "file") << "content";
    }
    // So that the user that the sandbox makes us may do there what the sandbox does not refuse.
    fs::permissions(root_, fs::perms::all);
    for (const auto& entry : fs::recursive_directory_iterator(root_)) fs::permissions(entry, fs::perms::all);
  }
  ~SandboxTest() override { fs::remove_all(root_); }

  std::string Own(const std::string& name) const { return (root_ / "own" / name).string(); }
  std::string Other(const std::string& name) const { return (root_ / "other" / name).string(); }
  SandboxOptions Options() const { return {.writable = {Own("")}, .network = true}; }

  /// Succeeds outside the sandbox, and fails inside it with `error`.
  void ExpectRefused(const char* name, const Attempt& attempt, int error) const {
    ExpectRefused(name, attempt, error, Options());
  }
  static void ExpectRefused(const char* name, const Attempt& attempt, int error,
                            const SandboxOptions& options) {
    EXPECT_EQ(Try(&options, attempt), error) << name << " inside";
    EXPECT_EQ(Try(nullptr, attempt), 0) << name << " outside";
  }
  void ExpectAllowed(const char* name, const Attempt& attempt) const {
    const SandboxOptions options = Options();
    EXPECT_EQ(Try(&options, attempt), 0) << name;
  }

  fs::path root_;
};

TEST_F(SandboxTest, RefusesProgramsProcessesAndTracing) {
  ExpectRefused("execve", [] { return ErrorOf(execl("/bin/true", "true", nullptr)); }, EPERM);
  ExpectRefused(
      "fork",
      [] {
        const pid_t child = fork();
        if (child == 0) _exit(0);
        return ErrorOf(child);
      },
      EPERM);
  ExpectRefused("system", [] { return std::system("true") == 0 ? 0 : 1; }, 1);
  ExpectRefused("ptrace", [] { return ErrorOf(ptrace(PTRACE_TRACEME, 0, nullptr, nullptr)); }, EPERM);
  ExpectRefused("a signal to another process", [] { return ErrorOf(kill(getppid(), 0)); }, EPERM);
  // A call that the C library replaces by clone; 0 is no valid size of its arguments.
  const SandboxOptions options = Options();
  EXPECT_EQ(Try(&options, [] { return ErrorOf(syscall(SYS_clone3, nullptr, 0)); }), ENOSYS);
  EXPECT_EQ(Try(nullptr, [] { return ErrorOf(syscall(SYS_clone3, nullptr, 0)); }), EINVAL);
}

TEST_F(SandboxTest, AllowsThreadsAndSignalsToItself) {
  ExpectAllowed("threads", [] {
    std::atomic<int> runs{0};
    std::thread first([&] { ++runs; });
    std::thread second([&] { ++runs; });
    first.join();
    second.join();
    return runs == 2 ? 0 : 1;
  });
  ExpectAllowed("a signal to itself", [] { return ErrorOf(kill(getpid(), 0)); });
  const SandboxOptions options = Options();
  EXPECT_EQ(Try(&options, []() -> int { std::abort(); }), 128 + SIGABRT);
}

TEST_F(SandboxTest, RefusesWhatOnlyRootMayDo) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root, to be refused something";
  ExpectRefused("mount", [] { return ErrorOf(mount("none", "/proc", "proc", MS_REMOUNT, nullptr)); }, EPERM);
  ExpectRefused("a new namespace", [] { return ErrorOf(unshare(CLONE_NEWUTS)); }, EPERM);
  ExpectRefused("a raw socket", [] { return ErrorOf(socket(AF_PACKET, SOCK_RAW, 0)); }, EAFNOSUPPORT);
  ExpectRefused("another user", [] { return ErrorOf(setuid(65534)); }, EPERM);
  ExpectRefused("another owner", [this] { return ErrorOf(chown(Own("file").c_str(), 1, 1)); }, EPERM);
  ExpectRefused(
      "a device", [this] { return ErrorOf(mknod(Own("null").c_str(), S_IFCHR | 0600, 0x103)); }, EPERM);
}

TEST_F(SandboxTest, FilesAreThoseOfTheSystemAndItsOwn) {
  ExpectAllowed("its own file", [this] { return OpenAndClose(Own("new"), O_WRONLY | O_CREAT); });
  ExpectAllowed("renaming it",
                [this] { return ErrorOf(rename(Own("file").c_str(), Own("renamed").c_str())); });
  ExpectAllowed("names of machines", [] { return OpenAndClose("/etc/hosts", O_RDONLY); });
  ExpectAllowed("random numbers", [] { return OpenAndClose("/dev/urandom", O_RDONLY); });
  if (Landlock::KernelVersion() == 0) GTEST_SKIP() << "this kernel has no Landlock";
  ExpectRefused("reading another file", [this] { return OpenAndClose(Other("file"), O_RDONLY); }, EACCES);
  ExpectRefused("writing it", [this] { return OpenAndClose(Other("file"), O_WRONLY); }, EACCES);
  ExpectRefused("making one", [this] { return OpenAndClose(Other("new"), O_WRONLY | O_CREAT); }, EACCES);
  ExpectRefused(
      "moving one out", [this] { return ErrorOf(link(Own("renamed").c_str(), Other("l").c_str())); }, EACCES);
  ExpectRefused(
      "the memory of others",
      [] { return OpenAndClose("/proc/" + std::to_string(getppid()) + "/environ", O_RDONLY); }, EACCES);
  ExpectRefused(
      "programs of the temporary folder", [] { return OpenAndClose("/tmp", O_RDONLY | O_DIRECTORY); },
      EACCES);
  // Last, for it succeeds outside.
  ExpectRefused("removing one", [this] { return ErrorOf(unlink(Other("file").c_str())); }, EACCES);
}

TEST_F(SandboxTest, RootBecomesAnotherUserAndCannotReturn) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  SandboxOptions options = Options();
  options.user = "nobody";
  const passwd* nobody = getpwnam("nobody");
  ASSERT_NE(nobody, nullptr);
  const uid_t id = nobody->pw_uid;
  const auto is_nobody_alone = [&] {
    return Try(&options,
               [id] { return getuid() == id && geteuid() == id && getgroups(0, nullptr) == 0 ? 0 : 1; });
  };
  EXPECT_EQ(is_nobody_alone(), 0);
  const auto in_a_group = [&] {
    const gid_t group = 12345;
    return setgroups(1, &group) == 0 ? is_nobody_alone() : errno;
  };
  EXPECT_EQ(Try(nullptr, in_a_group), 0);
  EXPECT_EQ(Try(&options, [] { return setuid(0) == 0 ? 0 : errno; }), EPERM);
  ExpectRefused("passwords", [] { return OpenAndClose("/etc/shadow", O_RDONLY); }, EACCES, options);
}

TEST_F(SandboxTest, RootThatStaysHasNoSecretsAndNoCapabilities) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  ExpectRefused(
      "the file of another user",
      [this] {
        if (chmod(Own("").c_str(), 0700) != 0) return 99;
        return OpenAndClose("/etc/shadow", O_RDONLY);
      },
      EACCES);
  ASSERT_EQ(chown(Own("file").c_str(), 12345, 12345), 0);
  ASSERT_EQ(chmod(Own("file").c_str(), 0600), 0);
  ExpectRefused(
      "the private file of another user in its folder",
      [this] { return OpenAndClose(Own("file"), O_RDONLY); }, EACCES);
  SandboxOptions options = Options();
  options.keep_file_access = true;
  EXPECT_EQ(Try(&options, [this] { return OpenAndClose(Own("file"), O_RDONLY); }), 0);
}

TEST_F(SandboxTest, NetworkIsForClients) {
  const Listener listener;
  ExpectAllowed("connecting", [&] { return Connect(listener.port()); });
  ExpectAllowed("names", [] {
    addrinfo* found = nullptr;
    const int error = getaddrinfo("localhost", "80", nullptr, &found);
    if (found != nullptr) freeaddrinfo(found);
    return error == 0 ? 0 : 1;
  });
  ExpectRefused("listening", Listen, EPERM);
  SandboxOptions options = Options();
  options.network = false;
  ExpectRefused("sockets", [&] { return Connect(listener.port()); }, EPERM, options);
}

TEST_F(SandboxTest, AcceptsOnSocketsThatListenAlready) {
  const Listener listener;
  const Attempt accepting = [&] { return listener.Accept(); };
  ExpectRefused("accepting", accepting, EPERM);
  SandboxOptions options = Options();
  options.accepts = true;
  EXPECT_EQ(Try(&options, accepting), 0);
  ExpectRefused("listening", Listen, EPERM, options);
}

TEST_F(SandboxTest, ConnectsToTheGivenPortsOnly) {
  if (Landlock::KernelVersion() < 4) GTEST_SKIP() << "this kernel's Landlock has no ports";
  const Listener coordinator;
  const Listener other;
  SandboxOptions options = Options();
  options.connect_ports = {coordinator.port()};
  EXPECT_EQ(Try(&options, [&] { return Connect(coordinator.port()); }), 0);
  ExpectRefused("another port", [&] { return Connect(other.port()); }, EACCES, options);
}

TEST_F(SandboxTest, LimitsOpenFilesTheirSizeAndCoreDumps) {
  SandboxOptions options = Options();
  options.open_files = 20;
  options.file_bytes = 1000;
  ExpectRefused(
      "open files",
      [] {
        for (int i = 0; i < 30; ++i) {
          if (open("/dev/null", O_RDONLY) < 0) return errno;
        }
        return 0;
      },
      EMFILE, options);
  ExpectRefused(
      "size",
      [this] {
        const int file = open(Own("file").c_str(), O_WRONLY);
        return ErrorOf(pwrite(file, "x", 1, 1000));
      },
      EFBIG, options);
  EXPECT_EQ(Try(&options,
                [] {
                  rlimit limit = {};
                  getrlimit(RLIMIT_CORE, &limit);
                  return limit.rlim_max == 0 ? 0 : 1;
                }),
            0);
}

TEST_F(SandboxTest, LimitsMemory) {
#if defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "not under AddressSanitizer";
#endif
  SandboxOptions options = Options();
  options.memory_bytes = uint64_t{1} << 30;
  ExpectRefused(
      "memory",
      [] {
        void* const memory =
            mmap(nullptr, size_t{2} << 30, PROT_READ, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        return memory == MAP_FAILED ? errno : 0;
      },
      ENOMEM, options);
}

TEST_F(SandboxTest, ReportsWhatIsUp) {
  const SandboxOptions options = Options();
  EXPECT_EQ(
      Try(nullptr,
          [&] {
            const absl::StatusOr<SandboxReport> report = EnterSandbox(options);
            if (!report.ok()) return 1;
            const bool has_landlock = testing::Matches(Contains(HasSubstr("landlock (files")))(report->up);
            const bool lacks_landlock = testing::Matches(Contains(HasSubstr("landlock")))(report->lacking);
            if (has_landlock == lacks_landlock || has_landlock != (Landlock::KernelVersion() > 0)) return 2;
            return testing::Matches(Contains("system calls"))(report->up) ? 0 : 3;
          }),
      0);
}

TEST_F(SandboxTest, IsNoSandboxForThreadsThatRunAlready) {
  EXPECT_EQ(Try(nullptr,
                [] {
                  std::atomic<bool> ended{false};
                  std::thread other([&] {
                    while (!ended) std::this_thread::yield();
                  });
                  const absl::Status status = EnterSandbox({}).status();
                  ended = true;
                  other.join();
                  return absl::IsFailedPrecondition(status) ? 0 : 1;
                }),
            0);
  if (geteuid() == 0) {
    EXPECT_EQ(EnterSandbox({.user = "no such user"}).status(),
              absl::NotFoundError("sandbox: no user 'no such user'"));
  }
}

TEST(DefaultMemory, IsMoreForMoreThreads) {
  EXPECT_GT(DefaultMemoryBytes(1), uint64_t{1} << 30);
  EXPECT_GT(DefaultMemoryBytes(8), DefaultMemoryBytes(1));
}

TEST(DefaultMemory, IsThatOfTheControlGroupWhereItIsLess) {
  const TempFolder folder;
  const uint64_t of_machine = DefaultMemoryBytes(1, {folder.path(), ""});
  constexpr uint64_t kLess = uint64_t{1} << 20;
  std::filesystem::create_directory(folder.PathOf("memory"));
  const std::vector<std::pair<std::string, bool>> limits = {// and whether they are less than the machine's
                                                            {std::to_string(kLess), true},
                                                            {"9223372036854771712", false},
                                                            {"max", false}};
  for (const char* file : {"memory.max", "memory/memory.limit_in_bytes"}) {
    std::filesystem::remove(folder.PathOf("memory.max"));
    for (const auto& [limit, is_less] : limits) {
      std::ofstream(folder.PathOf(file)) << limit << "\n";
      const uint64_t bytes = DefaultMemoryBytes(1, {folder.path(), ""});
      EXPECT_EQ(bytes < of_machine, is_less) << file << ": " << limit;
      EXPECT_GT(bytes, kLess) << "what threads reserve comes in addition";
    }
  }
}

TEST(UsableMemory, IsTheLeastOfTheProcessesOwnGroupAndThoseAboveIt) {
  const TempFolder folder;
  const ControlGroups groups = {folder.path(), folder.PathOf("membership")};
  const auto write = [&](const std::string& file, const std::string& text) {
    std::filesystem::create_directories(std::filesystem::path(folder.PathOf(file)).parent_path());
    std::ofstream(folder.PathOf(file)) << text << "\n";
  };
  write("membership", "0::/a/b");
  write("a/b/memory.max", "4000000");
  EXPECT_EQ(UsableMemoryBytes(groups), 4000000u);
  write("a/memory.max", "3000000");
  EXPECT_EQ(UsableMemoryBytes(groups), 3000000u);
  write("c/memory.max", "1000000");  // of others
  EXPECT_EQ(UsableMemoryBytes(groups), 3000000u);
  write("membership", "5:cpu:/a\n4:pids,memory:/slurm/job\n0::/a/b");
  write("memory/slurm/job/memory.limit_in_bytes", "2000000");
  EXPECT_EQ(UsableMemoryBytes(groups), 2000000u);
}

TEST(MemoryOfThisProcess, IsWhatALimitOfItsAddressesLeaves) {
  const uint64_t all = MemoryOfThisProcess(0, 1);
  EXPECT_GT(all, uint64_t{1} << 28);
  EXPECT_LE(all, UsableMemoryBytes());
  EXPECT_EQ(MemoryOfThisProcess(uint64_t{1} << 20, 1), 0u);
  EXPECT_EQ(Try(nullptr,
                [] {
                  const rlimit limit = {uint64_t{1} << 32, RLIM_INFINITY};
                  setrlimit(RLIMIT_AS, &limit);
                  const uint64_t left = MemoryOfThisProcess(0, 1);
                  const uint64_t beside_others = MemoryOfThisProcess(0, 9);
                  return left < uint64_t{1} << 32 && (beside_others < left || beside_others == left) ? 0 : 1;
                }),
            0);
}

}  // namespace
}  // namespace lumifold::sandbox
