#pragma once

#include <string_view>

namespace hedgehop::bus {

/// Tells the supervisor that started this process (systemd, or whatever else reads the socket that
/// NOTIFY_SOCKET names) how it is: lines of `key=value` as sd_notify(3) defines them, "READY=1",
/// "WATCHDOG=1", "STATUS=planning". Does nothing without a supervisor, and nothing when it does not
/// listen. Returns whether the words were taken.
bool tell_supervisor(std::string_view lines);

}  // namespace hedgehop::bus
