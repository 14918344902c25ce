/* soter_messages.hpp: what the traits of topics use.
 *
 * Purpose: stamps that are numbers. Non-goals: nodes. C++11.
 */
#ifndef SOTER_MESSAGES_HPP
#define SOTER_MESSAGES_HPP

#include <ros/time.h>

#include <cstdint>

namespace soter {



} /* namespace soter */

#endif
