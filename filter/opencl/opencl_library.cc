#include "filter/opencl/opencl_library.h"

#include <dlfcn.h>

#include "absl/strings/str_cat.h"

namespace lumifold::filter {
namespace {

absl::StatusOr<OpenClLibrary> Load() {
  void* const handle = dlopen("libOpenCL.so.1", RTLD_NOW | RTLD_LOCAL);
  if (handle == nullptr) return absl::FailedPreconditionError("there is no libOpenCL.so.1");
  OpenClLibrary library;
#define LUMIFOLD_OPENCL_FUNCTION(name)                                           \
  library.name = reinterpret_cast<decltype(library.name)>(dlsym(handle, #name)); \
  if (library.name == nullptr) return absl::FailedPreconditionError("libOpenCL.so.1 has no " #name);
  LUMIFOLD_OPENCL_FUNCTIONS(LUMIFOLD_OPENCL_FUNCTION)
#undef LUMIFOLD_OPENCL_FUNCTION
  return library;
}

}  // namespace

absl::StatusOr<const OpenClLibrary*> LoadOpenCl() {
  static const absl::StatusOr<OpenClLibrary> library = Load();  // stays for the life of the process
  if (!library.ok()) return library.status();
  return &*library;
}

absl::Status OpenClStatus(cl_int error, const char* what) {
  if (error == CL_SUCCESS) return absl::OkStatus();
  const bool is_memory = error == CL_MEM_OBJECT_ALLOCATION_FAILURE || error == CL_OUT_OF_RESOURCES ||
                         error == CL_OUT_OF_HOST_MEMORY || error == CL_INVALID_BUFFER_SIZE;
  const absl::StatusCode code =
      is_memory ? absl::StatusCode::kResourceExhausted : absl::StatusCode::kInternal;
  return {code, absl::StrCat(what, ": OpenCL error ", error, is_memory ? " (out of memory)" : "")};
}

}  // namespace lumifold::filter
