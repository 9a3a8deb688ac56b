#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "messages/message.hpp"

namespace hedgehop::messages {

/// Name of the type of a message, by its fingerprint; none for one that this program does not know.
std::optional<std::string_view> type_of(ByteView bytes);

/// A message of any type as one line of JSON: the fields by name, as they were sent, unjudged. NaN
/// and infinities become null; of long arrays the first `elements_max` are shown and then the text
/// "... 12 more". Throws MessageError for a type that this program does not know and for bytes
/// that are not as long as the fields.
std::string describe(ByteView bytes, std::size_t elements_max = 64);

}  // namespace hedgehop::messages
