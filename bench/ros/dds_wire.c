/* dds_wire.c: every field of every sample, over the types of a package and no bridge.
 *
 * Purpose: reads rt/KEY_in of a peer with what idlc made of the package's IDL, checks all of each
 * sample, and answers with a sample of its own on rt/KEY_out; says at SIGTERM what it counted.
 * Non-goals: the bridge (dds_harness.c stands behind that).
 */
#include "dds_fields_messages.h"
#include "dds_values.h"

#include <dds/dds.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>

#include "wire_code.h"

static volatile sig_atomic_t ending = 0;
static void on_signal(int number) {
  (void)number;
  ending = 1;
}

typedef struct {
  dds_entity_t reader, writer;
  unsigned long read, misread, written;
  const char* first; /* what was misread first */
} side;

static void open_side(side* s, dds_entity_t in, const dds_topic_descriptor_t* type,
                      const char* from, const char* to) {
  dds_qos_t* const qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(10));
  dds_qset_history(qos, DDS_HISTORY_KEEP_ALL, 0);
  s->reader = dds_create_reader(in, dds_create_topic(in, type, from, NULL, NULL), qos, NULL);
  s->writer = dds_create_writer(in, dds_create_topic(in, type, to, NULL, NULL), qos, NULL);
  dds_delete_qos(qos);
}

#define SERVE(KEY, TYPE)                                                                       \
  static void serve_##KEY(side* s) {                                                           \
    void* sample[1] = {NULL};                                                                  \
    dds_sample_info_t info[1];                                                                 \
    while (dds_take(s->reader, sample, info, 1, 1) > 0) {                                      \
      const TYPE* const m = sample[0];                                                         \
      if (info[0].valid_data) {                                                                \
        static TYPE own;                                                                       \
        const uint32_t k = counter_##KEY(m);                                                   \
        const char* const wrong = check_##KEY(m, k, 0);                                        \
        s->read++;                                                                             \
        s->misread += wrong != NULL;                                                           \
        s->first = s->first == NULL ? wrong : s->first;                                        \
        fill_##KEY(&own, k);                                                                   \
        s->written += dds_write(s->writer, &own) == DDS_RETCODE_OK;                            \
      }                                                                                        \
      (void)dds_return_loan(s->reader, sample, 1);                                             \
    }                                                                                          \
  }
SERVE(odom, nav_msgs_msg_dds__Odometry_)
SERVE(scan, sensor_msgs_msg_dds__LaserScan_)

static void say(const char* key, const side* s, const char* end) {
  (void)printf("\"%s\":{\"read\":%lu,\"misread\":%lu,\"written\":%lu,\"first\":\"%s\"}%s", key,
               s->read, s->misread, s->written, s->first != NULL ? s->first : "", end);
}

int main(void) {
  side odom = {0}, scan = {0};
  (void)signal(SIGTERM, on_signal);
  const dds_entity_t in = dds_create_participant((uint32_t)atoi(getenv("ROS_DOMAIN_ID")), NULL, NULL);
  open_side(&odom, in, &nav_msgs_msg_dds__Odometry__desc, "rt/odom_in", "rt/odom_out");
  open_side(&scan, in, &sensor_msgs_msg_dds__LaserScan__desc, "rt/scan_in", "rt/scan_out");
  const dds_entity_t set = dds_create_waitset(in);
  (void)dds_set_status_mask(odom.reader, DDS_DATA_AVAILABLE_STATUS);
  (void)dds_set_status_mask(scan.reader, DDS_DATA_AVAILABLE_STATUS);
  (void)dds_waitset_attach(set, odom.reader, 0);
  (void)dds_waitset_attach(set, scan.reader, 0);
  (void)fprintf(stderr, "wire runs\n");
  while (ending == 0) {
    (void)dds_waitset_wait(set, NULL, 0, DDS_MSECS(100));
    serve_odom(&odom);
    serve_scan(&scan);
  }
  (void)printf("{");
  say("odom", &odom, ",");
  say("scan", &scan, "}\n");
  return 0;
}
