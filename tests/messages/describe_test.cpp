#include "messages/describe.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <limits>

#include "messages/map_tiles.hpp"
#include "messages/message_error.hpp"
#include "support/example_messages.hpp"

namespace hedgehop::messages {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::StartsWith;

TEST(Describe, EveryTypeOnAChannelIsShownToItsLastByte) {
  for (const auto& [channel, bytes] : test::example_of_each_channel()) {
    const std::string text = describe(bytes);
    const auto type = type_of(bytes);
    ASSERT_TRUE(type.has_value()) << channel;
    EXPECT_THAT(text, StartsWith("{\"type\":\"" + std::string(*type) +
                                 "\",\"utime\":1700000000123456,\"sender_id\":4711,\"seq\":42,"));
    EXPECT_THAT(text, EndsWith("}"));
    Bytes longer = bytes;
    longer.push_back(std::byte{0});
    EXPECT_THROW(describe(longer), MessageError) << channel;
    for (std::size_t size = 0; size < bytes.size(); ++size) {
      EXPECT_THROW(describe(ByteView(bytes).first(size)), MessageError) << channel << ' ' << size;
    }
  }
}

TEST(Describe, FieldsHaveTheirNamesAndValues) {
  const std::string patch = describe(to_message(test::example_map_patch(), test::kExampleStamp));
  EXPECT_THAT(patch, HasSubstr("\"base_map_hash\":[1,2],\"patch_number\":5,\"patch_id\":77,"));
  EXPECT_THAT(patch, HasSubstr("\"is_present\":true"));
  EXPECT_THAT(patch, HasSubstr("\"vertex_x_m\":[1,3,5],\"vertex_y_m\":[2,4,6.5],"));
  EXPECT_THAT(patch, HasSubstr("\"label\":\"crane\"}"));
  const std::string request =
      describe(to_message(test::example_plan_request(), test::kExampleStamp));
  EXPECT_THAT(request, HasSubstr("\"start\":{\"latitude_rad\":0.87,"));
  EXPECT_THAT(request, HasSubstr("\"height_m\":null"));  // not asked for: NaN
}

TEST(Describe, TextsAreEscapedAndLongArraysCut) {
  MapPatchState state = test::example_map_patch_state();
  state.refusal = "a \"quoted\" back\\slash\nand line";
  EXPECT_THAT(describe(to_message(state, test::kExampleStamp)),
              HasSubstr("\"refusal\":\"a \\\"quoted\\\" back\\\\slash\\nand line\""));
  EXPECT_THAT(describe(to_message(test::example_map_patch(), test::kExampleStamp), 2),
              HasSubstr("\"vertex_x_m\":[1,3,\"... 1 more\"]"));
}

TEST(Describe, ABlobIsShownTooAndAnUnknownTypeIsRefused) {
  EXPECT_THAT(describe(encode_planning_config("speed_mps: 40.0\n")),
              HasSubstr("speed_mps: 40.0\\n"));
  Bytes unknown(40, std::byte{1});
  EXPECT_FALSE(type_of(unknown).has_value());
  EXPECT_THROW(describe(unknown), MessageError);
}

}  // namespace
}  // namespace hedgehop::messages
