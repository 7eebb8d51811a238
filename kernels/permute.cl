// A row-major tensor of three modes with its modes in another order, one of them the inner loop:
//
//   out[i][j][k] = in[i step_i + j step_j + k step_k]        i < I, j < J, k < K
//
// Work-item (i).
__attribute__((reqd_work_group_size(1, 1, 1)))
__kernel void permute(ulong J, ulong K, ulong step_i, ulong step_j, ulong step_k,
                      __global const float* restrict in, ulong first_out,
                      __global float* restrict out) {
  const ulong i = get_global_id(0);
  __global float* to = out + first_out + i * J * K;
  for (ulong j = 0; j < J; ++j) {
    __global const float* from = in + i * step_i + j * step_j;
    for (ulong k = 0; k < K; ++k) to[j * K + k] = from[k * step_k];
  }
}
