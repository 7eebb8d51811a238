// Writes 1 to elements [0, n) of `out`, and 2 to element `stray`, wherever that lies.
kernel void stray_writes(global float* out, const ulong n, const long stray) {
  const ulong i = get_global_id(0);
  if (i < n) out[i] = 1.0f;
  if (i == 0 && stray != 0) out[stray] = 2.0f;
}
