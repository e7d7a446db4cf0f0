#include "proto/device/device_option.h"

#include <string>

#include "filter/opencl/open_device.h"

namespace lumifold::device {

CLI::Validator KnownDevice() {
  return {[](const std::string& choice) { return std::string(filter::CheckDeviceChoice(choice).message()); },
          ""};
}

}  // namespace lumifold::device
