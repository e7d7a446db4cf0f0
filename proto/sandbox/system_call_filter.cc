#include "proto/sandbox/system_call_filter.h"

#include <linux/sched.h>
#include <seccomp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"

namespace lumifold::sandbox {
namespace {

/// Calls that are refused whatever their arguments. The library leaves out those that a processor does not
/// have.
constexpr int kRefused[] = {
    // New programs and other processes.
    SCMP_SYS(execve),
    SCMP_SYS(execveat),
    SCMP_SYS(fork),
    SCMP_SYS(vfork),
    SCMP_SYS(ptrace),
    SCMP_SYS(process_vm_readv),
    SCMP_SYS(process_vm_writev),
    SCMP_SYS(process_madvise),
    SCMP_SYS(kcmp),
    SCMP_SYS(pidfd_open),
    SCMP_SYS(pidfd_getfd),
    SCMP_SYS(pidfd_send_signal),
    SCMP_SYS(tkill),
    // Mounts, namespaces and roots.
    SCMP_SYS(mount),
    SCMP_SYS(umount2),
    SCMP_SYS(pivot_root),
    SCMP_SYS(chroot),
    SCMP_SYS(open_tree),
    SCMP_SYS(move_mount),
    SCMP_SYS(fsopen),
    SCMP_SYS(fsconfig),
    SCMP_SYS(fsmount),
    SCMP_SYS(fspick),
    SCMP_SYS(mount_setattr),
    SCMP_SYS(unshare),
    SCMP_SYS(setns),
    SCMP_SYS(swapon),
    SCMP_SYS(swapoff),
    // The kernel and its most attacked parts.
    SCMP_SYS(init_module),
    SCMP_SYS(finit_module),
    SCMP_SYS(delete_module),
    SCMP_SYS(kexec_load),
    SCMP_SYS(kexec_file_load),
    SCMP_SYS(reboot),
    SCMP_SYS(bpf),
    SCMP_SYS(perf_event_open),
    SCMP_SYS(userfaultfd),
    SCMP_SYS(io_uring_setup),
    SCMP_SYS(io_uring_enter),
    SCMP_SYS(io_uring_register),
    SCMP_SYS(add_key),
    SCMP_SYS(request_key),
    SCMP_SYS(keyctl),
    SCMP_SYS(syslog),
    SCMP_SYS(acct),
    SCMP_SYS(quotactl),
    SCMP_SYS(personality),
    SCMP_SYS(vhangup),
    SCMP_SYS(iopl),
    SCMP_SYS(ioperm),
    SCMP_SYS(modify_ldt),
    // The machine's clock and name.
    SCMP_SYS(settimeofday),
    SCMP_SYS(clock_settime),
    SCMP_SYS(clock_adjtime),
    SCMP_SYS(adjtimex),
    SCMP_SYS(sethostname),
    SCMP_SYS(setdomainname),
    // Users, owners and special files.
    SCMP_SYS(setuid),
    SCMP_SYS(setgid),
    SCMP_SYS(setreuid),
    SCMP_SYS(setregid),
    SCMP_SYS(setresuid),
    SCMP_SYS(setresgid),
    SCMP_SYS(setfsuid),
    SCMP_SYS(setfsgid),
    SCMP_SYS(setgroups),
    SCMP_SYS(capset),
    SCMP_SYS(chown),
    SCMP_SYS(lchown),
    SCMP_SYS(fchown),
    SCMP_SYS(fchownat),
    SCMP_SYS(mknod),
    SCMP_SYS(mknodat),
    SCMP_SYS(name_to_handle_at),
    SCMP_SYS(open_by_handle_at),
    // Being a server.
    SCMP_SYS(listen),
};

/// Rules of a filter that allows what no rule refuses. After the first error the others do nothing.
class Filter {
 public:
  Filter() : context_(seccomp_init(SCMP_ACT_ALLOW), &seccomp_release) {
    if (context_ == nullptr) error_ = -ENOMEM;
    // Calls of another architecture have other numbers.
    Note([this] { return seccomp_attr_set(context_.get(), SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS); });
  }

  template <typename... Conditions>
  void Refuse(int call, int error, Conditions... conditions) {
    Note([&] {
      const std::array<scmp_arg_cmp, sizeof...(conditions)> all = {conditions...};
      return seccomp_rule_add_array(context_.get(), SCMP_ACT_ERRNO(static_cast<uint32_t>(error)), call,
                                    sizeof...(conditions), all.data());
    });
  }

  /// Puts the filter in force. 0, or the negative number of the first error.
  int Load() {
    Note([this] { return seccomp_load(context_.get()); });
    return error_;
  }

 private:
  template <typename Step>
  void Note(const Step& step) {
    if (error_ == 0) error_ = step();
  }

  std::unique_ptr<void, decltype(&seccomp_release)> context_;
  int error_ = 0;
};

/// Arguments that are looked at have 32 bits: the upper half of their register means nothing to the kernel.
scmp_arg_cmp Is(unsigned argument, uint64_t value, uint64_t mask = 0xffffffff) {
  return {argument, SCMP_CMP_MASKED_EQ, mask, value};
}
scmp_arg_cmp IsNot(unsigned argument, uint64_t value) { return {argument, SCMP_CMP_NE, value, 0}; }
scmp_arg_cmp IsAbove(unsigned argument, uint64_t value) { return {argument, SCMP_CMP_GT, value, 0}; }

void AddSocketRules(const SocketRules& sockets, Filter* filter) {
  if (!sockets.accepts) {
    for (const int call : {SCMP_SYS(accept), SCMP_SYS(accept4)}) filter->Refuse(call, EPERM);
  }
  if (sockets.network) {
    constexpr std::array<uint64_t, 4> kAllowed = {AF_UNIX, AF_INET, AF_INET6, AF_NETLINK};
    for (uint64_t family = 0; family < kAllowed.back(); ++family) {
      if (std::find(kAllowed.begin(), kAllowed.end(), family) == kAllowed.end())
        filter->Refuse(SCMP_SYS(socket), EAFNOSUPPORT, Is(0, family));
    }
    filter->Refuse(SCMP_SYS(socket), EAFNOSUPPORT, IsAbove(0, kAllowed.back()));
  } else {
    for (const int call : {SCMP_SYS(socket), SCMP_SYS(connect), SCMP_SYS(bind)}) filter->Refuse(call, EPERM);
  }
}

}  // namespace

absl::Status FilterSystemCalls(const SocketRules& sockets) {
  Filter filter;
  for (const int call : kRefused) filter.Refuse(call, EPERM);
  // Threads, but no processes. The flags of clone3 are in memory, where a filter cannot look: without it the
  // C library uses clone.
  filter.Refuse(SCMP_SYS(clone3), ENOSYS);
  filter.Refuse(SCMP_SYS(clone), EPERM, Is(0, 0, CLONE_THREAD));
  const auto self = static_cast<uint64_t>(getpid());
  for (const int call :
       {SCMP_SYS(kill), SCMP_SYS(tgkill), SCMP_SYS(rt_sigqueueinfo), SCMP_SYS(rt_tgsigqueueinfo)})
    filter.Refuse(call, EPERM, IsNot(0, self));
  // Input that seems to come from the terminal.
  for (const uint64_t request : {TIOCSTI, TIOCLINUX}) filter.Refuse(SCMP_SYS(ioctl), EPERM, Is(1, request));
  AddSocketRules(sockets, &filter);
  const int error = -filter.Load();
  if (error == 0) return absl::OkStatus();
  const std::string text = absl::StrCat("system calls: ", std::strerror(error));
  // EINVAL: a kernel without filters.
  return {error == EINVAL ? absl::StatusCode::kUnimplemented : absl::ErrnoToStatusCode(error), text};
}

}  // namespace lumifold::sandbox
