/* liblcm, found when something first asks for it: a wheel carries neither it nor glib. The runtime speaks udpm://
 * itself; other providers, `tiller sim` over LCM and `tiller replay` over LCM need `pip install "tiller[lcm]"` or the
 * system's liblcm. TILLER_LIBLCM names the file; the package sets it where the Python package lcm is installed. */
#include <dlfcn.h>
#include <lcm/lcm.h>
#include <stdio.h>
#include <stdlib.h>

static void* library(void) {
  static void* handle;
  const char* named = getenv("TILLER_LIBLCM");
  if (handle == NULL && named != NULL && *named != '\0') handle = dlopen(named, RTLD_NOW | RTLD_LOCAL);
  if (handle == NULL) handle = dlopen("liblcm.so.1", RTLD_NOW | RTLD_LOCAL);
  return handle;
}

/* The functions below are called with what lcm_create returned: where that is null, none of them is. */
static void* function(const char* name) {
  void* found = library() != NULL ? dlsym(library(), name) : NULL;
  if (found != NULL) return found;
  fprintf(stderr, "tiller: liblcm has no %s; install lcm 1.5\n", name);
  abort();
}

#define FUNCTION(name, type) ((type)function(name))

lcm_t* lcm_create(const char* provider) {
  if (library() != NULL) return FUNCTION("lcm_create", lcm_t * (*)(const char*))(provider);
  fprintf(stderr, "tiller: liblcm is not installed; pip install \"tiller[lcm]\", or the package liblcm1\n");
  return NULL;
}
void lcm_destroy(lcm_t* lcm) { FUNCTION("lcm_destroy", void (*)(lcm_t*))(lcm); }
int lcm_get_fileno(lcm_t* lcm) { return FUNCTION("lcm_get_fileno", int (*)(lcm_t*))(lcm); }
int lcm_handle(lcm_t* lcm) { return FUNCTION("lcm_handle", int (*)(lcm_t*))(lcm); }
int lcm_handle_timeout(lcm_t* lcm, int timeout_ms) {
  return FUNCTION("lcm_handle_timeout", int (*)(lcm_t*, int))(lcm, timeout_ms);
}
int lcm_publish(lcm_t* lcm, const char* channel, const void* data, unsigned int size) {
  return FUNCTION("lcm_publish", int (*)(lcm_t*, const char*, const void*, unsigned int))(lcm, channel, data, size);
}
lcm_subscription_t* lcm_subscribe(lcm_t* lcm, const char* channel, lcm_msg_handler_t handler, void* user) {
  return FUNCTION("lcm_subscribe", lcm_subscription_t * (*)(lcm_t*, const char*, lcm_msg_handler_t, void*))(
      lcm, channel, handler, user);
}
int lcm_unsubscribe(lcm_t* lcm, lcm_subscription_t* subscription) {
  return FUNCTION("lcm_unsubscribe", int (*)(lcm_t*, lcm_subscription_t*))(lcm, subscription);
}
