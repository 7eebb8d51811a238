// Replaces two functions of OpenCL in a test program, for the Oclgrind simulator's check for
// uninitialised memory (as of version 21.10):
//
//   clReleaseMemObject  nothing is released, so that the place of one buffer is never given to
//                       another. What was known of the former would be taken for the latter's:
//                       reads of what nobody wrote are missed, and those of what was are reported,
//                       and all beyond the former's size counts as never written
//   clCreateBuffer      host memory is copied instead of used: what is used counts as never written
//                       (it would have to be mapped for writing first)
//
// Elsewhere the OpenCL library's own functions are called.
#include <CL/cl.h>
#include <dlfcn.h>

#include <cstdlib>

namespace {

// Set by the command oclgrind for its option --uninitialized.
bool is_simulated() {
  static const bool simulated = std::getenv("OCLGRIND_UNINITIALIZED") != nullptr;
  return simulated;
}

}  // namespace

extern "C" cl_int CL_API_CALL clReleaseMemObject(cl_mem memobj) {
  if (is_simulated()) return CL_SUCCESS;
  static const auto release =
      reinterpret_cast<decltype(&clReleaseMemObject)>(dlsym(RTLD_NEXT, "clReleaseMemObject"));
  return release(memobj);
}

extern "C" cl_mem CL_API_CALL clCreateBuffer(cl_context context, cl_mem_flags flags, size_t size,
                                             void* host_ptr, cl_int* status) {
  static const auto create =
      reinterpret_cast<decltype(&clCreateBuffer)>(dlsym(RTLD_NEXT, "clCreateBuffer"));
  constexpr cl_mem_flags uses = CL_MEM_USE_HOST_PTR;
  if (is_simulated() && (flags & uses) != 0) {
    flags = (flags & ~uses) | cl_mem_flags{CL_MEM_COPY_HOST_PTR};
  }
  return create(context, flags, size, host_ptr, status);
}
