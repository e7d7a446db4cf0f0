#pragma once

#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

/// The functions of OpenCL 1.2 that are used. The library is found when the program runs: nothing links it.
#define LUMIFOLD_OPENCL_FUNCTIONS(F) \
  F(clBuildProgram)                  \
  F(clCreateBuffer)                  \
  F(clCreateCommandQueue)            \
  F(clCreateContext)                 \
  F(clCreateKernel)                  \
  F(clCreateProgramWithSource)       \
  F(clEnqueueCopyBuffer)             \
  F(clEnqueueNDRangeKernel)          \
  F(clEnqueueReadBuffer)             \
  F(clEnqueueWriteBuffer)            \
  F(clFinish)                        \
  F(clGetDeviceIDs)                  \
  F(clGetDeviceInfo)                 \
  F(clGetPlatformIDs)                \
  F(clGetPlatformInfo)               \
  F(clGetProgramBuildInfo)           \
  F(clReleaseCommandQueue)           \
  F(clReleaseContext)                \
  F(clReleaseKernel)                 \
  F(clReleaseMemObject)              \
  F(clReleaseProgram)                \
  F(clSetKernelArg)

namespace lumifold::filter {

struct OpenClLibrary {
// NOLINTNEXTLINE(bugprone-macro-parentheses): a member's name
#define LUMIFOLD_OPENCL_FUNCTION(name) decltype(&::name) name = nullptr;
  LUMIFOLD_OPENCL_FUNCTIONS(LUMIFOLD_OPENCL_FUNCTION)
#undef LUMIFOLD_OPENCL_FUNCTION
};

/// libOpenCL.so.1, which finds the drivers.
/// Errors:  kFailedPrecondition: this machine has none, or one before OpenCL 1.2.
/// Threads: safe concurrently.
absl::StatusOr<const OpenClLibrary*> LoadOpenCl();

/// `error` of the function `what`. Errors: kResourceExhausted for memory, else kInternal.
absl::Status OpenClStatus(cl_int error, const char* what);

}  // namespace lumifold::filter
