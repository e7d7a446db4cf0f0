#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace lumifold::sandbox {

/// Rules of Landlock (landlock(7)). Paths that do not exist are left out.
struct LandlockRules {
  std::vector<std::string> readable;
  std::vector<std::string> writable;
  std::vector<uint16_t> connect_ports;  // TCP; empty: not restricted
};

/// A set of rules that is not in force yet, so that its paths are opened while the process may still do so.
class Landlock {
 public:
  /// The kernel's version of Landlock; 0 without it.
  static int KernelVersion();

  /// Requires KernelVersion() > 0. Errors: those of the system, naming the path.
  static absl::StatusOr<Landlock> Create(const LandlockRules& rules);
  Landlock(Landlock&& other) noexcept;
  Landlock& operator=(Landlock&&) = delete;
  ~Landlock();

  /// Restricts this thread and those it will start. Requires no_new_privs. Errors: those of the system.
  absl::Status Enforce() const;

  /// What it restricts, by the kernel's version: "files, ports, signals".
  std::string Scope() const;

 private:
  Landlock(int version, int rules, bool has_ports)
      : version_(version), rules_(rules), has_ports_(has_ports) {}

  int version_;
  int rules_;
  bool has_ports_;
};

}  // namespace lumifold::sandbox
