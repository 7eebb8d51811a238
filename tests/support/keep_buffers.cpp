// Replaces clReleaseMemObject in a test program: on the Oclgrind simulator nothing is released, so
// that it never gives the place of one buffer to another. Its check for uninitialised memory (as of
// version 21.10) takes what was known of the former buffer for the latter's: it misses reads of
// what nobody wrote, and reports those of what was.
//
// Elsewhere the OpenCL library's own function is called.
#include <CL/cl.h>
#include <dlfcn.h>

#include <cstdlib>

extern "C" cl_int CL_API_CALL clReleaseMemObject(cl_mem memobj) {
  // set by the command oclgrind for its option --uninitialized
  static const bool keep = std::getenv("OCLGRIND_UNINITIALIZED") != nullptr;
  if (keep) return CL_SUCCESS;
  static const auto release =
      reinterpret_cast<decltype(&clReleaseMemObject)>(dlsym(RTLD_NEXT, "clReleaseMemObject"));
  return release(memobj);
}
