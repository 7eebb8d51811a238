// Names of OpenCL status codes, for messages.
#pragma once

#include <CL/cl.h>

namespace weft {

// "CL_OUT_OF_RESOURCES"; "an unknown status" for a code that is not in the standard.
const char* cl_status_name(cl_int status);

}  // namespace weft
