/* soter_dds_samples.c: samples of DDS into channels, and channels into samples.
 *
 * Purpose: a topic's reader or writer, and the loop of its thread (soter_dds_bridge.h).
 * Non-goals: who the others are (soter_dds_peers.c).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_dds_topics.h"

#include "dds/ddsi/ddsi_serdata.h"

#include <stdlib.h>
#include <string.h>

#define AT_ONCE 16
#define LOOK_NS DDS_MSECS(100)      /* whether it is to end is asked so often */
#define RESEND_NS INT64_C(20000000) /* what does not change is said so often */
#define WAIT_NS INT64_C(5000000)
#define BLOCK_NS DDS_MSECS(10) /* a reader that stopped may hold a reliable writer so long */

/* ------------------------------------------------------------------ opening */

/* A writer says no type information: a reader of ROS 2 compares names of members, where one release
 * differs from the next, and none of them needs it. */
dds_topic_descriptor_t* soter_dds_plain(const dds_topic_descriptor_t* type) {
  SOTER_CHECK(type != NULL);
  const dds_topic_descriptor_t plain = {.m_size = type->m_size,
                                        .m_align = type->m_align,
                                        .m_flagset = type->m_flagset & ~DDS_TOPIC_XTYPES_METADATA,
                                        .m_nkeys = type->m_nkeys,
                                        .m_typename = type->m_typename,
                                        .m_keys = type->m_keys,
                                        .m_nops = type->m_nops,
                                        .m_ops = type->m_ops,
                                        .m_meta = type->m_meta};
  dds_topic_descriptor_t* const made = malloc(sizeof plain);
  if (made != NULL) {
    (void)memcpy(made, &plain, sizeof plain);
  }
  return made;
}

dds_qos_t* soter_dds_qos_of(const soter_dds_qos* asked) {
  static const dds_data_representation_id_t plain = DDS_DATA_REPRESENTATION_XCDR1;
  dds_qos_t* const qos = dds_create_qos();
  dds_qset_reliability(
      qos, asked->reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT, BLOCK_NS);
  dds_qset_durability(
      qos, asked->transient_local ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  dds_qset_history(qos, asked->depth > 0 ? DDS_HISTORY_KEEP_LAST : DDS_HISTORY_KEEP_ALL,
                   asked->depth);
  dds_qset_data_representation(qos, 1, &plain); /* what ROS 2 speaks */
  return qos;
}

static const char* open_reader(soter_dds_topic* topic, dds_entity_t of, dds_qos_t* qos) {
  SOTER_CHECK(topic->in != NULL && topic->end == 0);
  /* names of members differ between releases of ROS 2; all else of a type has to be the same */
  dds_qset_type_consistency(qos, DDS_TYPE_CONSISTENCY_ALLOW_TYPE_COERCION, false, false, true,
                            false, false);
  topic->end = dds_create_reader(topic->bridge->participant, of, qos, NULL);
  topic->waitset = dds_create_waitset(topic->bridge->participant);
  if (topic->end < 0 || topic->waitset < 0 ||
      dds_set_status_mask(topic->end, DDS_DATA_AVAILABLE_STATUS) < 0 ||
      dds_waitset_attach(topic->waitset, topic->end, 0) < 0) {
    return "DDS makes no reader";
  }
  topic->message = calloc(1, topic->in->type->m_size);
  topic->value = calloc(1, topic->in->size);
  return topic->message == NULL || topic->value == NULL ? "there is no memory" : NULL;
}

static const char* open_writer(soter_dds_topic* topic, dds_entity_t of, dds_qos_t* qos) {
  SOTER_CHECK(topic->out != NULL && topic->end == 0);
  topic->end = dds_create_writer(topic->bridge->participant, of, qos, NULL);
  if (topic->end < 0) {
    return "DDS makes no writer";
  }
  topic->message = calloc(1, topic->out->type->m_size);
  topic->value = calloc(1, topic->out->size);
  topic->last_value = calloc(1, topic->out->size);
  topic->begun = soter_dds_monotonic_ns();
  return topic->message == NULL || topic->value == NULL || topic->last_value == NULL
             ? "there is no memory"
             : NULL;
}

const char* soter_dds_open_topic(soter_dds_topic* topic, const char* folder) {
  SOTER_CHECK((topic->in != NULL) != (topic->out != NULL));
  const bool inward = topic->in != NULL;
  const dds_topic_descriptor_t* type = inward ? topic->in->type : topic->out->type;
  const char* wrong = inward ? soter_outside_open(&topic->channel, folder, topic->in->name,
                                                  topic->in->hash, topic->in->size, true)
                             : soter_outside_open(&topic->channel, folder, topic->out->name,
                                                  topic->out->hash, topic->out->size, false);
  if (wrong != NULL) {
    return wrong;
  }
  if (!inward || !topic->bridge->types_checked) {
    type = topic->described = soter_dds_plain(type);
  }
  if (type == NULL) {
    return "there is no memory";
  }
  dds_qos_t* const qos = soter_dds_qos_of(inward ? &topic->in->qos : &topic->out->qos);
  const dds_entity_t of =
      dds_create_topic(topic->bridge->participant, type, topic->topic, qos, NULL);
  if (of < 0) {
    wrong = "DDS makes no such topic";
  } else {
    wrong = inward ? open_reader(topic, of, qos) : open_writer(topic, of, qos);
  }
  dds_delete_qos(qos);
  return wrong;
}

void soter_dds_close_topic(soter_dds_topic* topic) {
  free(topic->message);
  free(topic->value);
  free(topic->last_value);
  free(topic->described);
}

/* ------------------------------------------------------------------ in */

/* False where a sample is not as long as its value would be written: of another type, which has the
 * same name, or with something behind it. */
static bool fits(const struct ddsi_serdata* sample, const void* message) {
  SOTER_CHECK(sample != NULL && message != NULL);
  struct ddsi_serdata* const again = ddsi_serdata_from_sample(sample->type, SDK_DATA, message);
  if (again == NULL) {
    return false;
  }
  const bool same = (ddsi_serdata_size(sample) + 3U) / 4U == (ddsi_serdata_size(again) + 3U) / 4U;
  ddsi_serdata_unref(again);
  return same;
}

static bool measured_at(soter_dds_topic* topic, int64_t* measured) {
  SOTER_CHECK(topic->in != NULL && measured != NULL);
  const int64_t error = topic->bridge->clock_error_ns;
  const int64_t now = soter_dds_monotonic_ns(); /* first: see the wall clock below */
  *measured = now - topic->in->delay_ns;
  if (!topic->in->stamped) {
    return true;
  }
  const int64_t stamp = topic->in->stamp(topic->message);
  if (stamp <= 0) {
    soter_dds_count(topic, SOTER_DDS_UNSTAMPED, "a sample has no stamp");
    return false;
  }
  const int64_t age = soter_dds_wall_ns() - stamp; /* who is held up here makes it older */
  if (age < -error) {
    soter_dds_count(topic, SOTER_DDS_FUTURE,
                    "a sample was stamped later than now: two clocks, or a wrong one");
    return false;
  }
  if (stamp < topic->last_stamp) {
    soter_dds_count(topic, SOTER_DDS_BACKWARDS,
                    "a sample was stamped earlier than the one before it");
    return false;
  }
  topic->last_stamp = stamp;
  *measured = now - age - error;
  *measured = *measured > now ? now : *measured;
  return true;
}

static void judge(soter_dds_topic* topic, const struct ddsi_serdata* sample,
                  dds_instance_handle_t writer) {
  SOTER_CHECK(topic->message != NULL && topic->value != NULL);
  const soter_dds_inward* const in = topic->in;
  int64_t measured = 0;
  if (!soter_dds_may_write(topic, writer)) {
    return;
  }
  if (!ddsi_serdata_to_sample(sample, topic->message, NULL, NULL)) {
    soter_dds_count(topic, SOTER_DDS_UNREAD, "a sample could not be read");
  } else if (!fits(sample, topic->message)) {
    soter_dds_count(topic, SOTER_DDS_SIZE, "a sample is longer than its type says");
  } else if (!in->frame(topic->message)) {
    soter_dds_count(topic, SOTER_DDS_FRAME, "a sample is in another frame");
  } else if (measured_at(topic, &measured)) {
    (void)memset(topic->value, 0, in->size);
    if (in->convert(topic->message, topic->value)) {
      soter_outside_write(&topic->channel, measured, topic->value);
      soter_dds_count(topic, SOTER_DDS_TAKEN, NULL);
    } else {
      soter_dds_count(topic, SOTER_DDS_ABSENT,
                      "a sample has no such element, or a number that the topic cannot hold");
    }
  }
  dds_sample_free(topic->message, in->type, DDS_FREE_CONTENTS);
  (void)memset(topic->message, 0, in->type->m_size);
}

void* soter_dds_serve_inward(void* given) {
  soter_dds_topic* const topic = given;
  SOTER_CHECK(topic != NULL && topic->in != NULL);
  struct ddsi_serdata* samples[AT_ONCE];
  dds_sample_info_t infos[AT_ONCE];
  while (!soter_dds_ending()) {
    const dds_return_t told = dds_waitset_wait(topic->waitset, NULL, 0, LOOK_NS);
    int32_t many = 0;
    while (told > 0 && !soter_dds_ending() &&
           (many = dds_takecdr(topic->end, samples, AT_ONCE, infos, DDS_ANY_STATE)) > 0) {
      SOTER_CHECK(many <= AT_ONCE);
      for (int32_t i = 0; i < many; i++) {
        if (infos[i].valid_data) {
          judge(topic, samples[i], infos[i].publication_handle);
        }
        ddsi_serdata_unref(samples[i]);
      }
    }
  }
  return NULL;
}

/* ------------------------------------------------------------------ out */

static void publish_value(soter_dds_topic* topic, int64_t now, int64_t written) {
  SOTER_CHECK(topic->message != NULL && topic->last_value != NULL);
  const int64_t wall = soter_dds_wall_ns(); /* first: who is held up here makes a value older */
  (void)memset(topic->message, 0, topic->out->type->m_size); /* its texts are constants */
  topic->out->convert(topic->last_value, wall - (soter_dds_monotonic_ns() - written),
                      topic->message);
  if (dds_write(topic->end, topic->message) < 0) {
    soter_dds_count(topic, SOTER_DDS_UNSENT,
                    "DDS did not take a sample: a reliable reader does not read");
  } else {
    soter_dds_count(topic, SOTER_DDS_PUBLISHED, NULL);
  }
  topic->told = now;
}

static void set_silent(soter_dds_topic* topic, bool silent) {
  (void)pthread_mutex_lock(&topic->held);
  topic->silent = silent;
  (void)pthread_mutex_unlock(&topic->held);
}

/* A channel may hold what somebody wrote long ago, or before this machine was started; and whoever
 * writes it may have been stopped between the time and the value. */
static bool is_of_now(const soter_dds_topic* topic, int64_t written) {
  SOTER_CHECK(topic->out != NULL && topic->begun > 0);
  const int64_t age = soter_dds_monotonic_ns() - written;
  return written >= topic->begun && age >= 0 && age <= topic->out->silent_ns;
}

/* A value of now; `topic->before`: whether there was one at all. */
static bool read_channel(soter_dds_topic* topic, int64_t* written) {
  SOTER_CHECK(topic->value != NULL && written != NULL);
  const bool found = soter_outside_read(&topic->channel, written, topic->value, NULL);
  topic->before = topic->before || found;
  return found && is_of_now(topic, *written);
}

/* Whether the writer of the channel was gone when the bridge began. */
static bool was_gone(const soter_dds_topic* topic, int64_t now) {
  return topic->heard == 0 && topic->before && now - topic->begun > topic->out->silent_ns;
}

static void relay_channel(soter_dds_topic* topic, int64_t now) {
  SOTER_CHECK(topic->value != topic->last_value);
  const soter_dds_outward* const out = topic->out;
  int64_t written = 0;
  if (read_channel(topic, &written)) {
    const bool changed = memcmp(topic->value, topic->last_value, out->size) != 0;
    (void)memcpy(topic->last_value, topic->value, out->size);
    topic->heard = now;
    set_silent(topic, false);
    if (changed || now - topic->told >= RESEND_NS) {
      publish_value(topic, now, written);
    }
  } else if (topic->heard > 0 && now - topic->heard > out->silent_ns &&
             now - topic->told >= RESEND_NS) {
    set_silent(topic, true); /* nobody holds a lease, nobody holds the law: it is held from here */
    if (out->law(topic->last_value)) {
      publish_value(topic, now, now);
    }
  } else if (was_gone(topic, now)) {
    set_silent(topic, true);
  }
}

void* soter_dds_serve_outward(void* given) {
  soter_dds_topic* const topic = given;
  SOTER_CHECK(topic != NULL && topic->out != NULL);
  while (!soter_dds_ending()) {
    soter_outside_wait(&topic->channel, WAIT_NS);
    relay_channel(topic, soter_dds_monotonic_ns());
  }
  if (topic->heard > 0 && topic->out->law(topic->last_value)) {
    publish_value(topic, soter_dds_monotonic_ns(), soter_dds_monotonic_ns()); /* the law is last */
  }
  return NULL;
}
