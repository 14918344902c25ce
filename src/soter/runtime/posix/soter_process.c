/* soter_process.c: see soter_process.h.
 *
 * Purpose: standard output and standard error become pipes of this process, which a thread each
 * empties into what they were. Non-goals: as there. It waits by poll: the clock may be a test's.
 */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* what Linux has beyond C99 and POSIX */
#endif

#include "soter_process.h"

#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#define LINE_MOST 1024 /* a pipe takes as much whole, or not at all */
#define PATIENCE_S 5U
#define BIT(number) (UINT64_C(1) << ((number) - 1))
#define IGNORED (BIT(SIGPIPE) | BIT(SIGXFSZ) | BIT(SIGTSTP) | BIT(SIGTTIN) | BIT(SIGTTOU))
/* no end, or none that can be handled; and faults, which are no message */
#define LEFT                                                                                 \
  (BIT(SIGKILL) | BIT(SIGSTOP) | BIT(SIGCONT) | BIT(SIGCHLD) | BIT(SIGURG) | BIT(SIGWINCH) | \
   BIT(SIGSEGV) | BIT(SIGBUS) | BIT(SIGFPE) | BIT(SIGILL) | BIT(SIGTRAP) | BIT(SIGSYS) |     \
   BIT(SIGABRT))

typedef struct {
  int from, to;
  bool busy; /* what is no longer in the pipe is on its way */
} relay;

int soter_process_stderr = STDERR_FILENO;
static relay relays[2];
static unsigned long lost; /* lines */
static volatile sig_atomic_t exit_code = EXIT_FAILURE;

static void* pass_on(void* given) {
  relay* const r = given;
  char bytes[4096];
  struct pollfd in = {.fd = r->from, .events = POLLIN};
  for (ssize_t many = 1; many > 0;) {
    (void)poll(&in, 1, -1);
    __atomic_store_n(&r->busy, true, __ATOMIC_SEQ_CST);
    many = read(r->from, bytes, sizeof bytes);
    for (ssize_t done = 0, told = 1; done < many && told > 0; done += told) {
      told = write(r->to, bytes + done, (size_t)(many - done));
    }
    __atomic_store_n(&r->busy, false, __ATOMIC_SEQ_CST);
  }
  return NULL;
}

static bool redirect(relay* r, int file) {
  int ends[2] = {-1, -1};
  pthread_t thread;
  pthread_attr_t attributes;
  r->to = fcntl(file, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
  (void)pipe2(ends, O_CLOEXEC);
  r->from = ends[0];
  (void)pthread_attr_init(&attributes);
  (void)pthread_attr_setstacksize(&attributes, 262144); /* it may be locked */
  (void)pthread_attr_setdetachstate(&attributes, PTHREAD_CREATE_DETACHED);
  return r->to >= 0 && fcntl(ends[1], F_SETFL, O_NONBLOCK) == 0 &&
         pthread_create(&thread, &attributes, pass_on, r) == 0 && dup2(ends[1], file) == file &&
         close(ends[1]) == 0;
}

static void set_signals(void (*on_end)(int)) {
  const struct sigaction act = {.sa_handler = on_end};
  struct sigaction was;
  for (int number = 1; number <= SIGRTMAX; number++) {
    const bool known = sigaction(number, NULL, &was) == 0;
    const bool nohup = number == SIGHUP && known && was.sa_handler == SIG_IGN;
    if (!known) { /* the C library's own, until it wants one */
      const uintptr_t ignored[8] = {(uintptr_t)SIG_IGN};
      (void)syscall(SYS_rt_sigaction, number, ignored, NULL, 8U);
    } else if ((IGNORED & BIT(number)) != 0U) {
      (void)signal(number, SIG_IGN);
    } else if ((LEFT & BIT(number)) == 0U && !nohup) {
      (void)sigaction(number, &act, NULL);
    }
  }
  (void)signal(SIGCHLD, SIG_DFL); /* where it is ignored nobody learns how a child ended */
}

bool soter_process_begin(void (*on_end)(int)) {
  sigset_t mask;
  int file = 0;
  while ((file = open("/dev/null", O_RDWR)) >= 0 && file <= STDERR_FILENO) {
  }
  (void)close(file);
  (void)setvbuf(stdout, NULL, _IOLBF, BUFSIZ); /* as on a terminal */
  set_signals(on_end);
  (void)sigfillset(&mask); /* of the threads: one that is interrupted would lose words */
  (void)pthread_sigmask(SIG_SETMASK, &mask, NULL);
  if (!redirect(&relays[0], STDOUT_FILENO) || !redirect(&relays[1], STDERR_FILENO)) {
    perror("not run: there is no pipe or thread for what it says");
    return false;
  }
  (void)sigemptyset(&mask);
  (void)pthread_sigmask(SIG_SETMASK, &mask, NULL);
  soter_process_stderr = relays[1].to;
  return true;
}

void soter_process_say(const char* format, ...) {
  char line[LINE_MOST];
  const unsigned long before = __atomic_exchange_n(&lost, 0U, __ATOMIC_SEQ_CST);
  int size = before == 0U ? 0 : sprintf(line, "(%lu lines are lost)\n", before);
  va_list rest;
  va_start(rest, format);
  (void)vsnprintf(line + size, sizeof line - (size_t)size - 1U, format, rest);
  va_end(rest);
  (void)strcat(line, "\n");
  if (write(STDERR_FILENO, line, strlen(line)) < 0) {
    (void)__atomic_add_fetch(&lost, before + 1U, __ATOMIC_SEQ_CST);
  }
}

static void on_alarm(int number) {
  (void)number;
  _exit(exit_code);
}

static void await(const relay* r) {
  int waiting = 0;
  while (__atomic_load_n(&r->busy, __ATOMIC_SEQ_CST) ||
         (ioctl(r->from, FIONREAD, &waiting) == 0 && waiting > 0)) {
    (void)poll(NULL, 0, 1);
  }
}

void soter_process_ending(void) {
  (void)signal(SIGALRM, on_alarm);
  (void)alarm(PATIENCE_S);
  await(&relays[0]);
  (void)dup2(relays[0].to, STDOUT_FILENO);
}

int soter_process_end(int code) {
  soter_process_ending();
  exit_code = fflush(stdout) == 0 && ferror(stdout) == 0 ? code : EXIT_FAILURE;
  await(&relays[1]);
  return exit_code;
}
