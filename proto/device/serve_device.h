#pragma once

#include <string>
#include <vector>

namespace lumifold::device {

/// First argument of the process that has a device.
inline constexpr char kDeviceCommand[] = "filter-device";

/// The main function of a process that DeviceProcess has started; `arguments` are those after kDeviceCommand.
/// Returns the exit code, unless the device fails or the starter is gone: then it ends the process.
int RunDeviceProcess(const std::vector<std::string>& arguments);

// What it says over its standard input, a socket whose messages are these, each with a text behind it.

/// The name of the device, which is open, a newline, and filter::FilterDevice::OtherBits.
inline constexpr char kReady = '+';
/// There is none; the text is empty.
inline constexpr char kNone = '0';
/// Why it cannot be opened, or has failed.
inline constexpr char kFailed = '-';
/// Why it leaves work to the processors of callers.
inline constexpr char kLeaves = '~';

}  // namespace lumifold::device
