#include "worker/fence/system_call_filter.h"

#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/sched.h>
#include <linux/seccomp.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <vector>

#include "absl/strings/str_cat.h"

namespace lumifold::fence {
namespace {

#if defined(__x86_64__)
constexpr uint32_t kArchitecture = AUDIT_ARCH_X86_64;
#elif defined(__aarch64__)
constexpr uint32_t kArchitecture = AUDIT_ARCH_AARCH64;
#else
constexpr uint32_t kArchitecture = 0;
#endif

/// Calls that are refused whatever their arguments.
constexpr uint32_t kRefused[] = {
    // New programs and other processes.
    SYS_execve,
    SYS_execveat,
    SYS_ptrace,
    SYS_process_vm_readv,
    SYS_process_vm_writev,
    SYS_kcmp,
    SYS_pidfd_open,
    SYS_pidfd_getfd,
    SYS_pidfd_send_signal,
    SYS_process_madvise,
#ifdef SYS_fork
    SYS_fork,
    SYS_vfork,
#endif
    // Mounts, namespaces and roots.
    SYS_mount,
    SYS_umount2,
    SYS_pivot_root,
    SYS_chroot,
    SYS_open_tree,
    SYS_move_mount,
    SYS_fsopen,
    SYS_fsconfig,
    SYS_fsmount,
    SYS_fspick,
    SYS_mount_setattr,
    SYS_unshare,
    SYS_setns,
    SYS_swapon,
    SYS_swapoff,
    // The kernel and its most attacked parts.
    SYS_init_module,
    SYS_finit_module,
    SYS_delete_module,
    SYS_kexec_load,
    SYS_reboot,
    SYS_bpf,
    SYS_perf_event_open,
    SYS_userfaultfd,
    SYS_io_uring_setup,
    SYS_io_uring_enter,
    SYS_io_uring_register,
    SYS_add_key,
    SYS_request_key,
    SYS_keyctl,
    SYS_syslog,
    SYS_acct,
    SYS_quotactl,
    SYS_personality,
    SYS_vhangup,
#ifdef SYS_kexec_file_load
    SYS_kexec_file_load,
#endif
#ifdef SYS_iopl
    SYS_iopl,
    SYS_ioperm,
    SYS_modify_ldt,
#endif
    // The machine's clock and name.
    SYS_settimeofday,
    SYS_clock_settime,
    SYS_clock_adjtime,
    SYS_adjtimex,
    SYS_sethostname,
    SYS_setdomainname,
    // Users, owners and special files.
    SYS_setuid,
    SYS_setgid,
    SYS_setreuid,
    SYS_setregid,
    SYS_setresuid,
    SYS_setresgid,
    SYS_setfsuid,
    SYS_setfsgid,
    SYS_setgroups,
    SYS_capset,
    SYS_fchown,
    SYS_fchownat,
    SYS_mknodat,
    SYS_name_to_handle_at,
    SYS_open_by_handle_at,
#ifdef SYS_chown
    SYS_chown,
    SYS_lchown,
    SYS_mknod,
#endif
    // Being a server.
    SYS_listen,
};

constexpr uint32_t kEndProcess = SECCOMP_RET_KILL_PROCESS;
constexpr uint32_t kAllow = SECCOMP_RET_ALLOW;
constexpr uint32_t Fail(int error) {
  return SECCOMP_RET_ERRNO | (static_cast<uint32_t>(error) & SECCOMP_RET_DATA);
}

/// Assembles a filter in classic BPF. The accumulator holds the number of the call between blocks.
class Assembler {
 public:
  void Load(size_t offset) { Add(BPF_LD | BPF_W | BPF_ABS, 0, 0, static_cast<uint32_t>(offset)); }
  void LoadNumber() { Load(offsetof(seccomp_data, nr)); }
  /// The lower half of argument `index`: all arguments that are looked at have 32 bits.
  void LoadArgument(size_t index) {
    constexpr size_t kLowerHalf = __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__ ? 0 : 4;
    Load(offsetof(seccomp_data, args) + index * sizeof(uint64_t) + kLowerHalf);
  }
  void Return(uint32_t action) { Add(BPF_RET | BPF_K, 0, 0, action); }
  void ReturnIf(uint32_t comparison, uint32_t value, uint32_t action) {
    Add(static_cast<uint16_t>(BPF_JMP | comparison | BPF_K), 0, 1, value);
    Return(action);
  }

  void ReturnUnless(uint32_t value, uint32_t action) {
    Add(BPF_JMP | BPF_JEQ | BPF_K, 1, 0, value);
    Return(action);
  }

  /// For a call of this number, decides by argument `index`: `if_listed` for the values, else `otherwise`.
  void DecideByArgument(uint32_t number, size_t index, std::initializer_list<uint32_t> values,
                        uint32_t if_listed, uint32_t otherwise, uint32_t comparison = BPF_JEQ) {
    const auto skipped = static_cast<uint8_t>(2 * values.size() + 2);
    Add(BPF_JMP | BPF_JEQ | BPF_K, 0, skipped, number);
    LoadArgument(index);
    for (const uint32_t value : values) ReturnIf(comparison, value, if_listed);
    Return(otherwise);
  }

  const std::vector<sock_filter>& program() const { return program_; }

 private:
  void Add(uint32_t code, uint8_t if_true, uint8_t if_false, uint32_t value) {
    program_.push_back({static_cast<uint16_t>(code), if_true, if_false, value});
  }

  std::vector<sock_filter> program_;
};

std::vector<sock_filter> MakeFilter(const SocketRules& sockets) {
  Assembler filter;
  filter.Load(offsetof(seccomp_data, arch));
  filter.ReturnUnless(kArchitecture, kEndProcess);  // calls of another architecture have other numbers
  filter.LoadNumber();
#ifdef __x86_64__
  filter.ReturnIf(BPF_JGE, 0x40000000, Fail(ENOSYS));  // x32: other numbers for the same calls
#endif
  for (const uint32_t number : kRefused) filter.ReturnIf(BPF_JEQ, number, Fail(EPERM));
  // Threads, but no processes. The flags of clone3 are in memory, where a filter cannot look: without it the C library
  // uses clone.
  filter.ReturnIf(BPF_JEQ, SYS_clone3, Fail(ENOSYS));
  filter.DecideByArgument(SYS_clone, 0, {CLONE_THREAD}, kAllow, Fail(EPERM), BPF_JSET);
  const auto self = static_cast<uint32_t>(getpid());
  for (const uint32_t number : {SYS_kill, SYS_tgkill, SYS_rt_sigqueueinfo, SYS_rt_tgsigqueueinfo})
    filter.DecideByArgument(number, 0, {self}, kAllow, Fail(EPERM));
  filter.ReturnIf(BPF_JEQ, SYS_tkill, Fail(EPERM));
  // Input that seems to come from the terminal.
  filter.DecideByArgument(SYS_ioctl, 1, {TIOCSTI, TIOCLINUX}, Fail(EPERM), kAllow);
  if (!sockets.accepts) {
    for (const uint32_t number : {SYS_accept, SYS_accept4}) filter.ReturnIf(BPF_JEQ, number, Fail(EPERM));
  }
  if (sockets.network) {
    filter.DecideByArgument(SYS_socket, 0, {AF_INET, AF_INET6, AF_UNIX, AF_NETLINK}, kAllow,
                            Fail(EAFNOSUPPORT));
  } else {
    filter.ReturnIf(BPF_JEQ, SYS_socket, Fail(EPERM));
    filter.ReturnIf(BPF_JEQ, SYS_connect, Fail(EPERM));
    filter.ReturnIf(BPF_JEQ, SYS_bind, Fail(EPERM));
  }
  filter.Return(kAllow);
  return filter.program();
}

}  // namespace

absl::Status FilterSystemCalls(const SocketRules& sockets) {
  if (kArchitecture == 0) return absl::UnimplementedError("not written for this processor");
  const std::vector<sock_filter> filter = MakeFilter(sockets);
  const sock_fprog program = {static_cast<unsigned short>(filter.size()),
                              const_cast<sock_filter*>(filter.data())};
  if (prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0) return absl::OkStatus();
  const int error = errno;
  const std::string text = absl::StrCat("system calls: ", std::strerror(error));
  // EINVAL: a kernel without filters.
  return {error == EINVAL ? absl::StatusCode::kUnimplemented : absl::ErrnoToStatusCode(error), text};
}

}  // namespace lumifold::fence
