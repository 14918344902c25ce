/* The advanced controller of courier.soter, as a compiler of networks would write it.
 *
 * courier.h is generated from courier.soter; 0 says that the step went well. */
#include "courier.h"

int learned(const courier_Guard_Learned_in *in, courier_Guard_Learned_out *out);

int learned(const courier_Guard_Learned_in *in, courier_Guard_Learned_out *out) {
  out->speed = in->position < 11.0 ? 1.0 : -1.0; /* the wall is at 10 */
  out->has_speed = 1;
  return 0;
}
