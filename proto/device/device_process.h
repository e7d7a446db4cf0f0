#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "filter/manifold/filter_device.h"
#include "filter/opencl/open_device.h"
#include "proto/rpc/byte_stream.h"
#include "proto/subprocess/child.h"

namespace lumifold::device {

struct DeviceProcessOptions {
  /// The program to start; its main passes the arguments after kDeviceCommand to RunDeviceProcess.
  std::string program = "/proc/self/exe";
  filter::DeviceChoice choice = {};
  /// User that the process becomes if this one is root; empty: it stays.
  std::string user = {};
  /// Within which the device has to be opened, and to do the work of one call, the compilation of its kernels
  /// included. PoCL on two cores compiles in 15 s and filters a layer of a block in 30 s.
  absl::Duration time_limit = DefaultTimeLimit();
  /// Receives one line about a device that fails; from any thread.
  std::function<void(const std::string& line)> warn = [](const std::string&) {};

  /// 150 s, or the seconds in the environment's LUMIFOLD_DEVICE_SECONDS.
  static absl::Duration DefaultTimeLimit();
};

/// A device that filters, in a process of its own: drivers have threads and memory of their own, write files
/// and start programs, so that they fit no sandbox, and one that hangs or crashes takes nothing else with it.
/// The process ends with this object, and when this process ends.
/// Threads: safe.
class DeviceProcess {
 public:
  /// Starts the process and waits until the device is open. Null: the processor filters alone.
  /// Starts no thread, so that a sandbox can be entered afterwards.
  /// Errors: those of filter::OpenFilterDevice and subprocess::Child; kDeadlineExceeded for a driver that
  /// does not answer. With `auto` they are told to `warn`, and the processor filters.
  static absl::StatusOr<std::unique_ptr<DeviceProcess>> Start(DeviceProcessOptions options);
  DeviceProcess(const DeviceProcess&) = delete;
  DeviceProcess& operator=(const DeviceProcess&) = delete;
  ~DeviceProcess();

  const std::string& name() const { return name_; }
  /// As filter::FilterDevice::OtherBits.
  const std::string& other_bits() const { return other_bits_; }

  /// A connection for MakeDeviceLink, here or in a child process. Not valid once the device has failed.
  rpc::FileHandle Connect() ABSL_LOCKS_EXCLUDED(mutex_);
  /// A connection as a device.
  std::shared_ptr<filter::FilterDevice> Link();
  /// Warns, once, if the device has failed or leaves work, which it may be about to say: waits for that up to
  /// `patience`.
  void CheckTrouble(absl::Duration patience = absl::ZeroDuration()) ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  DeviceProcess(DeviceProcessOptions options, rpc::FileHandle control,
                std::unique_ptr<subprocess::Child> child)
      : options_(std::move(options)), child_(std::move(child)), control_(std::move(control)) {}

  absl::Status AwaitOpen();
  /// Waits for the first one up to `patience`.
  void ReadMessages(absl::Duration patience) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Fail(const std::string& reason) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const DeviceProcessOptions options_;
  std::unique_ptr<subprocess::Child> child_;
  std::string name_;  // empty: there is no device
  std::string other_bits_;
  absl::Mutex mutex_;
  rpc::FileHandle control_ ABSL_GUARDED_BY(mutex_);
  bool has_failed_ ABSL_GUARDED_BY(mutex_) = false;
};

/// Filters over a connection. When that ends, `on_trouble` is called, once, and the processor filters; also
/// when the device leaves the first call to the processor. `time_limit`: that of the process; a caller may
/// wait for others. `other_bits`: those of the process.
std::shared_ptr<filter::FilterDevice> MakeDeviceLink(rpc::FileHandle connection, std::string other_bits,
                                                     absl::Duration time_limit,
                                                     std::function<void()> on_trouble);

/// A process with a device and a connection to it, for a program that filters itself.
/// Errors: as Start().
absl::StatusOr<filter::OpenedDevice> OpenDevice(DeviceProcessOptions options);

}  // namespace lumifold::device
