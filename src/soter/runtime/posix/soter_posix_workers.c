/* soter_posix_workers.c: segments, and the process that starts workers.
 *
 * Purpose: before there is a thread, a second process is forked that starts, limits, ends and
 * restarts workers, so the trusted one never forks. Segments are sealed: a worker can neither cut
 * its own (which would end us with SIGBUS) nor write ours.
 * Non-goals: protection from a worker that means harm and has our user's rights: it may send us
 * signals. --worker-user gives it another (docs/real-time.md).
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_posix.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <linux/capability.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#ifndef F_SEAL_FUTURE_WRITE
#define F_SEAL_FUTURE_WRITE 0x0010
#endif

#define REQUEST_FD 3
#define ANSWER_FD 4
#define FIRST_OTHER_FD 5
#define LAST_OTHER_FD 1024
#define NAP_NS 2000000L
#define CPU_SLACK_S 10
#define NICENESS 5
#define NOT_STARTED 127
#define STAT_MAX 256

/* ------------------------------------------------------------------ segments */

static void* segment(size_t bytes, int* fd) {
  SOTER_CHECK(bytes >= sizeof(soter_channel_head));
  const int made = (int)syscall(SYS_memfd_create, "soter", 2U /* MFD_ALLOW_SEALING */);
  if (made < 0 || ftruncate(made, (off_t)bytes) != 0) {
    return NULL;
  }
  void* const at = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, made, 0);
  if (at == MAP_FAILED) {
    return NULL;
  }
  *fd = fcntl(made, F_DUPFD, 64); /* away from those that a worker has */
  (void)close(made);
  return at;
}

static bool segments(soter_posix* d) {
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    soter_worker* const w = &d->workers[k];
    SOTER_CHECK(w->request == NULL && w->answer == NULL);
    w->request = segment(soter_channel_bytes(soter_app_externs[k].in_size), &w->request_fd);
    w->answer = segment(soter_channel_bytes(soter_app_externs[k].out_size), &w->answer_fd);
    if (w->request == NULL || w->answer == NULL) {
      return false;
    }
    const int whole = F_SEAL_SHRINK | F_SEAL_GROW;
    const bool sealed =
        fcntl(w->request_fd, F_ADD_SEALS, whole | F_SEAL_FUTURE_WRITE | F_SEAL_SEAL) == 0 &&
        fcntl(w->answer_fd, F_ADD_SEALS, whole | F_SEAL_SEAL) == 0;
    if (!sealed) {
      return false;
    }
  }
  return true;
}

/* ------------------------------------------------------------------ a worker's side of the fork */

static void limit(int what, uint64_t most) {
  const struct rlimit r = {.rlim_cur = (rlim_t)most, .rlim_max = (rlim_t)most};
  (void)setrlimit((__rlimit_resource_t)what, &r);
}

/* Nothing of ours: no priority, no capability, few files, bounded memory and time. */
static void give_up_rights(const soter_posix* d) {
  SOTER_CHECK(d->options.until_ns > 0);
  const struct sched_param ordinary = {.sched_priority = 0};
  (void)sched_setscheduler(0, SCHED_OTHER, &ordinary);
  (void)setpriority(PRIO_PROCESS, 0, NICENESS);
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_RTPRIO, 0);
  limit(RLIMIT_MEMLOCK, 0);
  limit(RLIMIT_CPU, (uint64_t)(d->options.until_ns / 1000000000 + CPU_SLACK_S));
  if (d->options.memory_mib > 0U) {
    limit(RLIMIT_AS, d->options.memory_mib << 20);
  }
  (void)prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  for (unsigned long c = 0; c < 64UL; c++) {
    (void)prctl(PR_CAPBSET_DROP, c, 0, 0, 0);
  }
  if (d->options.user >= 0) {
    const uid_t user = (uid_t)d->options.user;
    (void)setgroups(0, NULL);
    if (setresgid((gid_t)user, (gid_t)user, (gid_t)user) != 0 || setresuid(user, user, user) != 0) {
      _exit(NOT_STARTED);
    }
  }
  struct __user_cap_header_struct header = {.version = _LINUX_CAPABILITY_VERSION_3, .pid = 0};
  struct __user_cap_data_struct none[2];
  (void)memset(none, 0, sizeof none);
  (void)syscall(SYS_capset, &header, none);
}

static void become_worker(const soter_posix* d, uint32_t k, pid_t parent) {
  const soter_worker* const w = &d->workers[k];
  SOTER_CHECK(w->request_fd >= FIRST_OTHER_FD && w->answer_fd >= FIRST_OTHER_FD);
  sigset_t none;
  (void)sigemptyset(&none);
  (void)sigprocmask(SIG_SETMASK, &none, NULL);
  for (int number = 1; number <= SIGRTMAX; number++) {
    (void)signal(number, SIG_DFL); /* what we ignore it need not */
  }
  (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent || setsid() < 0) {
    _exit(NOT_STARTED);
  }
  (void)dup2(w->request_fd, REQUEST_FD);
  (void)dup2(w->answer_fd, ANSWER_FD);
  const int words = open("/proc/self/fd/2", O_WRONLY | O_NONBLOCK); /* for us it stays as it is */
  (void)dup2(words, STDERR_FILENO);
  (void)dup2(STDERR_FILENO, STDOUT_FILENO); /* our standard output is ours */
  for (int fd = FIRST_OTHER_FD; fd < LAST_OTHER_FD; fd++) {
    (void)close(fd);
  }
  give_up_rights(d);
  if (w->command[0] == '/') {
    (void)execl(w->command, w->command, (char*)NULL);
  } else {
    (void)execl("/bin/sh", "sh", "-c", w->command, (char*)NULL);
  }
  _exit(NOT_STARTED);
}

/* ------------------------------------------------------------------ the process that starts them
 */

static void start_worker(soter_posix* d, uint32_t k) {
  soter_worker_status* const s = &d->status->worker[k];
  const pid_t self = getpid();
  SOTER_CHECK(s->pid == 0);
  const pid_t made = fork();
  if (made == 0) {
    become_worker(d, k, self);
  }
  __atomic_store_n(&s->error, made < 0 ? errno : 0, __ATOMIC_RELEASE);
  __atomic_store_n(&s->pid, made < 0 ? 0 : (int32_t)made, __ATOMIC_RELEASE);
  __atomic_store_n(&s->starts, s->starts + 1U, __ATOMIC_RELEASE);
}

/* Ends what is left of a worker's session and notes how it ended. */
static void end_worker(soter_posix* d, uint32_t k, int status) {
  soter_worker_status* const s = &d->status->worker[k];
  SOTER_CHECK(s->pid > 1); /* kill(0), kill(-1) would end others */
  (void)kill(-s->pid, SIGKILL);
  __atomic_store_n(&s->status, (int32_t)status, __ATOMIC_RELEASE);
  __atomic_store_n(&s->pid, 0, __ATOMIC_RELEASE);
  __atomic_store_n(&s->ends, s->ends + 1U, __ATOMIC_RELEASE);
}

static void look_after(soter_posix* d, uint32_t k, int64_t* ended_ns) {
  soter_worker_status* const s = &d->status->worker[k];
  const uint32_t asked = __atomic_load_n(&s->kill_asked, __ATOMIC_ACQUIRE);
  SOTER_CHECK(s->pid == 0 || s->pid > 1); /* kill(-1) would end everybody */
  if (s->pid != 0 && asked != s->kill_done) {
    (void)kill(-s->pid, SIGKILL);
    (void)kill(s->pid, SIGKILL);
  }
  int status = 0;
  if (s->pid != 0 && waitpid(s->pid, &status, WNOHANG) == s->pid) {
    end_worker(d, k, status);
    *ended_ns = soter_posix_clock();
  }
  if (s->pid == 0) {
    __atomic_store_n(&s->kill_done, asked, __ATOMIC_RELEASE);
    const bool there = d->workers[k].command[0] != '\0';
    if (there && s->starts <= d->options.restarts &&
        soter_posix_clock() - *ended_ns >= d->options.again_ns) {
      start_worker(d, k);
    }
  }
}

/* The parent of a process, from /proc; 0 where it has gone meanwhile. */
static pid_t parent_of(pid_t pid) {
  char path[32], text[STAT_MAX];
  SOTER_CHECK(pid > 0);
  (void)snprintf(path, sizeof path, "/proc/%ld/stat", (long)pid);
  const int fd = open(path, O_RDONLY | O_CLOEXEC);
  const ssize_t got = fd < 0 ? 0 : read(fd, text, sizeof text - 1U);
  if (fd >= 0) {
    (void)close(fd);
  }
  text[got > 0 ? got : 0] = '\0';
  const char* const name_ends = strrchr(text, ')');
  return name_ends == NULL || strlen(name_ends) < 5U ? 0 : (pid_t)strtol(name_ends + 4, NULL, 10);
}

/* Workers, and what they left behind in whatever session: it comes here when its parent ends. */
static void end_children(void) {
  const pid_t self = getpid();
  SOTER_CHECK(self > 1);
  do {
    DIR* const processes = opendir("/proc");
    for (struct dirent* e = NULL; processes != NULL && (e = readdir(processes)) != NULL;) {
      const pid_t pid = (pid_t)strtol(e->d_name, NULL, 10);
      if (pid > 1 && parent_of(pid) == self) {
        (void)kill(pid, SIGKILL);
      }
    }
    if (processes == NULL || closedir(processes) != 0) {
      return;
    }
  } while (waitpid(-1, NULL, 0) > 0);
}

/* What workers left behind, and what has ended since, is waited for. */
static void reap_orphans(const soter_posix* d) {
  siginfo_t ended;
  ended.si_pid = 0;
  SOTER_CHECK(d->status != NULL);
  if (waitid(P_ALL, 0, &ended, WEXITED | WNOHANG | WNOWAIT) != 0 || ended.si_pid == 0) {
    return;
  }
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    if (d->status->worker[k].pid == (int32_t)ended.si_pid) {
      return; /* `look_after` does */
    }
  }
  (void)waitpid(ended.si_pid, NULL, WNOHANG);
}

/* The one writer of a channel is the trusted process: another may follow as soon as it ends. */
static void close_channels(soter_posix* d) {
  SOTER_CHECK(d->keeper == 0); /* we are the process that was forked */
  for (uint32_t k = 0; k < soter_app_outside_count; k++) {
    soter_outside_close(&d->outside[k].channel);
  }
  for (uint32_t k = 0; k < soter_app_lease_count; k++) {
    soter_outside_close(&d->lease[k].channel);
  }
  soter_outside_close(&d->status_channel);
}

static void keep_workers(soter_posix* d, pid_t parent) {
  const struct timespec nap = {0, NAP_NS};
  int64_t ended_ns[APP_EXTERNS > 0 ? APP_EXTERNS : 1];
  (void)memset(ended_ns, 0, sizeof ended_ns);
  close_channels(d);
  (void)setsid(); /* who ends our whole group does not end what ends workers */
  (void)prctl(PR_SET_CHILD_SUBREAPER, 1);
  while (getppid() == parent && !__atomic_load_n(&d->status->over, __ATOMIC_ACQUIRE)) {
    for (uint32_t k = 0; k < soter_app_extern_count; k++) {
      look_after(d, k, &ended_ns[k]);
    }
    reap_orphans(d);
    (void)nanosleep(&nap, NULL);
  }
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    const int32_t pid = d->status->worker[k].pid;
    if (pid != 0) {
      (void)kill(-pid, SIGKILL);
      (void)kill(pid, SIGKILL);
      (void)waitpid(pid, NULL, 0);
    }
  }
  end_children();
  _exit(0);
}

void soter_posix_release(soter_posix* d) {
  if (d->keeper > 0) {
    SOTER_CHECK(d->status != NULL && !d->status->over);
    __atomic_store_n(&d->status->over, true, __ATOMIC_RELEASE);
    int status = 0;
    while (waitpid(d->keeper, &status, WUNTRACED) == d->keeper && WIFSTOPPED(status)) {
      (void)kill(d->keeper, SIGCONT); /* a worker stopped who keeps it: it goes on, to end */
    }
  }
}

/* ------------------------------------------------------------------ the trusted process's side */

/* The worker's own program lies beside ours. */
static bool find_program(soter_posix* d, uint32_t k, const char* self) {
  soter_worker* const w = &d->workers[k];
  SOTER_CHECK(self != NULL);
  const char* const slash = strrchr(self, '/');
  const int folder = slash == NULL ? 0 : (int)(slash - self) + 1;
  if (w->command[0] != '\0') {
    return true;
  }
  if (soter_app_externs[k].file == NULL) {
    return false;
  }
  char path[SOTER_COMMAND_MAX];
  (void)snprintf(path, sizeof path, "%.*s%s", folder, self, soter_app_externs[k].file);
  return realpath(path, w->command) != NULL && access(w->command, X_OK) == 0;
}

void soter_posix_workers(soter_posix* d, const char* self) {
  if (APP_EXTERNS == 0) {
    return;
  }
  SOTER_CHECK(d->keeper == 0 && d->status == NULL); /* once, before any thread */
  d->status =
      mmap(NULL, sizeof *d->status, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (d->status == MAP_FAILED || !segments(d)) {
    soter_posix_note(d,
                     "no shared memory (%s): no worker is started, and their modules stay with SC",
                     strerror(errno));
    return;
  }
  for (uint32_t k = 0; k < soter_app_extern_count; k++) {
    if (!find_program(d, k, self)) {
      const char* file = soter_app_externs[k].file;
      soter_posix_note(d, "the worker of %s cannot be started: %s `%s`: its module stays with SC",
                       APP_PROGRAM->component[soter_app_externs[k].component].name,
                       file != NULL ? "there is no program" : "nobody gave a program, by",
                       file != NULL ? file : "--worker NAME=COMMAND");
      d->workers[k].command[0] = '\0';
    }
  }
  d->shared = true;
  const pid_t parent = getpid();
  const pid_t made = fork();
  if (made == 0) {
    keep_workers(d, parent);
  }
  d->keeper = (int32_t)made;
  if (made < 0) {
    soter_posix_note(d, "no process can be made (%s): no worker is started", strerror(errno));
    d->shared = false;
  }
}

bool soter_posix_ready(soter_posix* d, uint32_t worker) {
  const soter_posix_extern* const x = &soter_app_externs[worker];
  SOTER_CHECK(worker < soter_app_extern_count && x->out_size <= sizeof d->value);
  soter_channel_head head;
  return soter_channel_read(d->workers[worker].answer, x->hash, x->out_size, 0U, &head, d->value) ==
         SOTER_CHANNEL_FRESH;
}

/* Waits, bounded, until workers are there: that saves AC its first answers. */
void soter_posix_await(soter_posix* d) {
  const struct timespec nap = {0, NAP_NS};
  const int64_t end_ns = soter_posix_clock() + d->options.wait_ns;
  for (uint32_t k = 0; d->shared && k < soter_app_extern_count; k++) {
    soter_worker_status* const s = &d->status->worker[k];
    SOTER_CHECK(d->workers[k].answer != NULL);
    while (d->workers[k].command[0] != '\0' && !soter_posix_ready(d, k) &&
           soter_posix_clock() < end_ns && __atomic_load_n(&s->ends, __ATOMIC_ACQUIRE) == 0U &&
           d->stop == 0) {
      (void)nanosleep(&nap, NULL);
    }
    if (d->workers[k].command[0] != '\0' && !soter_posix_ready(d, k)) {
      soter_posix_note(d, "the worker of %s is not ready: its module stays with SC until it is",
                       APP_PROGRAM->component[soter_app_externs[k].component].name);
    }
  }
}
