// Keeps the device busy for `rounds` dependent multiplications. Leaves a value that depends on the
// first byte of `in`, and so can't be known before.
__attribute__((reqd_work_group_size(1, 1, 1)))
kernel void spin(global const uchar* in, const ulong rounds, global float* out) {
  float x = in[0];
  for (ulong i = 0; i < rounds; ++i) x = x * 0.999f + 0.5f;
  out[0] = x;
}
