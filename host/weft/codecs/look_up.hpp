// Many look-ups of a user at once.
#pragma once

#include <cstdint>
#include <span>

#include "weft/codecs/codec.hpp"

namespace weft {

enum class LookupOrder {
  as_given,  // they come as a renderer's do: neighbours look up what is near
  by_image   // they come in any order: taken view by view and light by light
};

// out[i] = what record i of `lookups` asks for, [records][C] in the stored encoding, of the BTF of
// `shape` that the sampler looks up in. The records are checked first (validate_lookups) and handed
// to the device in batches as large as job.memory allows; the bits depend neither on that nor on
// the order.
void look_up(Device& device, DeviceSampler& sampler, const BtfShape& shape,
             const LookupShape& lookup, std::span<const std::uint32_t> lookups, LookupOrder order,
             std::span<float> out, Job& job);

}  // namespace weft
