// A libOpenCL.so.1 that forwards to the real one, and fails as the environment says:
//   FAULTY_OPENCL="FUNCTION:N:WHAT"  the N-th call of FUNCTION hangs (WHAT = hang), ends the process (crash), or
//                                    returns the error WHAT, a negative number
//   FAULTY_OPENCL_MEMORY=BYTES       the device has so much memory, and buffers no more together
//   FAULTY_OPENCL_LACKS=WHAT,...     what devices do not report: rounding, denormals, doubles
//   FAULTY_OPENCL_CALLS=FILE         gets the name of each function that waits for the device
// A program takes it by LD_LIBRARY_PATH.
#include <dlfcn.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <optional>
#include <string>

namespace {

using Word = std::uintptr_t;
// All arguments are integers and pointers, which go into registers and then onto the stack. A function gets more of
// them than it has.
using Function = Word (*)(Word, Word, Word, Word, Word, Word, Word, Word, Word, Word);

constexpr Word kMemorySize = 0x101F;     // CL_DEVICE_GLOBAL_MEM_SIZE
constexpr Word kLargestBuffer = 0x1010;  // CL_DEVICE_MAX_MEM_ALLOC_SIZE
constexpr Word kSingles = 0x101B;        // CL_DEVICE_SINGLE_FP_CONFIG
constexpr Word kDoubles = 0x1032;        // CL_DEVICE_DOUBLE_FP_CONFIG
constexpr uint64_t kDenormals = 1, kCorrectRounding = 1 << 7;
constexpr int kNoMemory = -4;  // CL_MEM_OBJECT_ALLOCATION_FAILURE

std::string Variable(const char* name) {
  const char* const text = std::getenv(name);
  return text == nullptr ? "" : text;
}

Function Real(const char* name) {
  static void* const library = dlopen(LUMIFOLD_REAL_OPENCL, RTLD_NOW | RTLD_LOCAL);
  return reinterpret_cast<Function>(library == nullptr ? nullptr : dlsym(library, name));
}

/// The error of this call; nullopt: it does not fail.
std::optional<int> FaultOf(const std::string& function) {
  static std::mutex mutex;
  static std::map<std::string, int> calls;
  int call = 0;
  {
    const std::lock_guard lock(mutex);
    call = ++calls[function];
  }
  const std::string fault = Variable("FAULTY_OPENCL");
  const std::string begin = function + ":" + std::to_string(call) + ":";
  if (fault.compare(0, begin.size(), begin) != 0) return std::nullopt;
  const std::string what = fault.substr(begin.size());
  if (what == "crash") std::abort();
  while (what == "hang") pause();
  return std::atoi(what.c_str());
}

void Log(const std::string& function) {
  const std::string path = Variable("FAULTY_OPENCL_CALLS");
  if (path.empty()) return;
  if (std::FILE* const file = std::fopen(path.c_str(), "a")) {
    std::fprintf(file, "%s\n", function.c_str());
    std::fclose(file);
  }
}

/// Buffers within the memory that the device is said to have.
class Memory {
 public:
  Word Create(Word a, Word b, Word bytes, Word d, Word error) {
    const std::lock_guard lock(mutex_);
    const std::optional<int> fault = FaultOf("clCreateBuffer");
    if (fault.has_value() || (limit_ > 0 && used_ + bytes > limit_)) {
      *reinterpret_cast<int*>(error) = fault.value_or(kNoMemory);
      return 0;
    }
    const Word buffer = Real("clCreateBuffer")(a, b, bytes, d, error, 0, 0, 0, 0, 0);
    if (buffer != 0) used_ += sizes_[buffer] = bytes;
    return buffer;
  }
  Word Release(Word buffer) {
    const std::lock_guard lock(mutex_);
    if (const auto found = sizes_.find(buffer); found != sizes_.end()) {
      used_ -= found->second;
      sizes_.erase(found);
    }
    return Real("clReleaseMemObject")(buffer, 0, 0, 0, 0, 0, 0, 0, 0, 0);
  }
  uint64_t limit() const { return limit_; }

 private:
  const uint64_t limit_ = std::strtoull(Variable("FAULTY_OPENCL_MEMORY").c_str(), nullptr, 10);
  std::mutex mutex_;
  std::map<Word, uint64_t> sizes_;
  uint64_t used_ = 0;
};
Memory& TheMemory() {
  static Memory memory;
  return memory;
}

Word GetDeviceInfo(Word device, Word what, Word size, Word value, Word e) {
  const Word result = Real("clGetDeviceInfo")(device, what, size, value, e, 0, 0, 0, 0, 0);
  if (value == 0 || size < sizeof(uint64_t)) return result;
  auto& number = *reinterpret_cast<uint64_t*>(value);
  const std::string lacks = Variable("FAULTY_OPENCL_LACKS");
  const auto has = [&lacks](const char* word) { return lacks.find(word) == std::string::npos; };
  const uint32_t parameter = static_cast<uint32_t>(what);
  if ((parameter == kMemorySize || parameter == kLargestBuffer) && TheMemory().limit() > 0)
    number = TheMemory().limit();
  if (parameter == kSingles && !has("rounding")) number &= ~kCorrectRounding;
  if (parameter == kSingles && !has("denormals")) number &= ~kDenormals;
  if (parameter == kDoubles && !has("doubles")) number = 0;
  return result;
}

Word Forward(const char* name, Word a, Word b, Word c, Word d, Word e, Word f, Word g, Word h, Word i,
             Word j) {
  const std::string function = name;
  if (function == "clCreateBuffer") return TheMemory().Create(a, b, c, d, e);
  if (function == "clReleaseMemObject") return TheMemory().Release(a);
  if (function == "clGetDeviceInfo") return GetDeviceInfo(a, b, c, d, e);
  if (function == "clFinish") Log(function);
  if (const std::optional<int> fault = FaultOf(function)) return static_cast<Word>(*fault);
  return Real(name)(a, b, c, d, e, f, g, h, i, j);
}

}  // namespace

#define FORWARD(name)                                                                                    \
  extern "C" Word name(Word a, Word b, Word c, Word d, Word e, Word f, Word g, Word h, Word i, Word j) { \
    return Forward(#name, a, b, c, d, e, f, g, h, i, j);                                                 \
  }
FORWARD(clBuildProgram)
FORWARD(clCreateBuffer)
FORWARD(clCreateCommandQueue)
FORWARD(clCreateContext)
FORWARD(clCreateKernel)
FORWARD(clCreateProgramWithSource)
FORWARD(clEnqueueCopyBuffer)
FORWARD(clEnqueueNDRangeKernel)
FORWARD(clEnqueueReadBuffer)
FORWARD(clEnqueueWriteBuffer)
FORWARD(clFinish)
FORWARD(clGetDeviceIDs)
FORWARD(clGetDeviceInfo)
FORWARD(clGetPlatformIDs)
FORWARD(clGetPlatformInfo)
FORWARD(clGetProgramBuildInfo)
FORWARD(clReleaseCommandQueue)
FORWARD(clReleaseContext)
FORWARD(clReleaseKernel)
FORWARD(clReleaseMemObject)
FORWARD(clReleaseProgram)
FORWARD(clSetKernelArg)
