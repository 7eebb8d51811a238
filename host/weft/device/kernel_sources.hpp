// The embedded OpenCL C sources, one per file of kernels/.
#pragma once

namespace weft {

struct KernelSource {
  const char* name;  // "gemm.cl"
  const char* text;
};

namespace kernel_sources {
extern const KernelSource weave;
}  // namespace kernel_sources

}  // namespace weft
