#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "base/observer.hpp"

namespace hedgehop::evaluation {

/// Sends one message from the child to its parent; of any bytes, up to 16 MB.
using SendMessage = std::function<void(std::string_view)>;

/// Runs `work` in a copy of this process, so that whatever it does to itself (a failed assertion, a
/// loop without end, state of a library that is never given back) ends with it.
///
/// The child sends messages, each of which is handed to `on_message` here, also those from before
/// it died. Its processor time begins at 0 and may not exceed `cpu_s_max`. It hears no signal
/// handlers of ours, writes nothing to standard error and leaves no core file. Only the calling
/// thread exists in it: the work must not lean on a pool of threads that was started before.
///
/// @return  empty if the work returned; else how it ended, in words.
/// @throws Interrupted    if the observer says so; the child is gone then.
/// @throws SystemFailure  if no process can be made.
std::string run_in_child(const std::function<void(const SendMessage&)>& work,
                         const std::function<void(std::string_view)>& on_message, double cpu_s_max,
                         const Observer& observer);

}  // namespace hedgehop::evaluation
