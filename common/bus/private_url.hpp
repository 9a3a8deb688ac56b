#pragma once

#include <string>

namespace hedgehop::bus {

/// A udpm URL that stays on this machine (ttl=0), on a port that nobody uses at the moment. LCM
/// listens to every group of a port, so a bus of one's own needs a port of its own. Throws
/// BusError.
std::string private_url();

}  // namespace hedgehop::bus
