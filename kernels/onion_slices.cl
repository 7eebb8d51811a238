// Where a pair of directions lies between the nodes of onion slices, lib/weft/btf/onion_slices.hpp,
// which says what the angles are: as places of vq_books.cl, 6 words of the view and 6 of the light.

// The nodes next to a place in steps from the first of `size` nodes, and its part of the step.
inline void put_step(float steps, uint size, uint level, uint* place) {
  const float within = clamp(steps, 0.0f, (float)(size - 1));
  const uint low = size > 1 ? min((uint)within, size - 2) : 0;
  place[2 * level] = low;
  place[2 * level + 1] = size > 1 ? low + 1 : 0;
  place[4 + level] = as_uint(within - (float)low);
}

// What is below the horizon is brought to it at its azimuth, straight down to azimuth 0.
inline float3 brought_to_horizon(float3 d) {
  d.z = d.z > 0.0f ? d.z : 0.0f;
  const float length_of = sqrt(d.x * d.x + d.y * d.y + d.z * d.z);
  return length_of > 0.0f ? d / length_of : (float3)(1.0f, 0.0f, 0.0f);
}

inline void onion_place(float3 view, float3 light, uint n_phi, uint n_theta, uint n_alpha,
                        uint n_beta, uint* of_view, uint* of_light) {
  const float3 v = brought_to_horizon(view);
  const float3 l = brought_to_horizon(light);
  // the view's azimuth and elevation; phi goes round
  const float sine = sqrt(v.x * v.x + v.y * v.y);
  const float turns = sine > 0.0f ? 0.5f * atan2pi(v.y, v.x) : 0.0f;
  const float phi = (turns < 0.0f ? turns + 1.0f : turns) * (float)n_phi;
  const uint low = min((uint)phi, n_phi - 1);
  of_view[0] = low;
  of_view[1] = low + 1 < n_phi ? low + 1 : 0;
  of_view[4] = as_uint(n_phi > 1 ? min(phi - (float)low, 1.0f) : 0.0f);
  put_step(2.0f * atan2pi(sine, v.z) * (float)(n_theta - 1), n_theta, 1, of_view);
  // the light, turned with the view
  const float c = sine > 0.0f ? v.x / sine : 1.0f;
  const float s = sine > 0.0f ? v.y / sine : 0.0f;
  const float x = c * l.x + s * l.y;
  const float y = c * l.y - s * l.x;
  const float alpha = x == 0.0f && l.z == 0.0f ? 0.0f : atan2pi(x, l.z);
  put_step((alpha + 0.5f) * (float)(n_alpha - 1), n_alpha, 0, of_light);
  put_step(0.5f * (y + 1.0f) * (float)(n_beta - 1), n_beta, 1, of_light);
}
