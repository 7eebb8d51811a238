// The embedded OpenCL C sources, one per file of kernels/.
#pragma once

namespace weft {

struct KernelSource {
  const char* name;  // "gemm.cl"
  const char* text;
};

namespace kernel_sources {
extern const KernelSource batch_omp;
extern const KernelSource clamp_values;
extern const KernelSource cluster_products;
extern const KernelSource convert_tile;
extern const KernelSource decode_lpca;
extern const KernelSource decode_pca;
extern const KernelSource decode_sparse;
extern const KernelSource decode_vq;
extern const KernelSource error_sums;
extern const KernelSource gemm;
extern const KernelSource gemm_tiled;
extern const KernelSource gram;
extern const KernelSource invert_colour;
extern const KernelSource ksvd_update;
extern const KernelSource light_slices;
extern const KernelSource log_error_sums;
extern const KernelSource look_up_factors;
extern const KernelSource look_up_train;
extern const KernelSource mode_product;
extern const KernelSource nearest_code_vector;
extern const KernelSource order_lookups;
extern const KernelSource look_up_raw;
extern const KernelSource look_up_sparse;
extern const KernelSource look_up_tucker;
extern const KernelSource look_up_vq;
extern const KernelSource pack_mode;
extern const KernelSource peak;
extern const KernelSource permute;
extern const KernelSource pick_channels;
extern const KernelSource reduce_mip;
extern const KernelSource render_surface;
extern const KernelSource scan_tile;
extern const KernelSource shade_points;
extern const KernelSource similar_code_vector;
extern const KernelSource ssim;
extern const KernelSource sum_squares;
extern const KernelSource syrk;
extern const KernelSource syrk_rows;
extern const KernelSource transcode_tile;
extern const KernelSource tsqr;
extern const KernelSource turn_channels;
extern const KernelSource unfold_tile;
extern const KernelSource weigh_directions;
extern const KernelSource weighted_squares;
}  // namespace kernel_sources

// kernels/tuning.json
extern const char* const shipped_tuning_text;

}  // namespace weft
