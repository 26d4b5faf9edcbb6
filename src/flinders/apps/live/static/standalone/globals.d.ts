/** Constants that `flinders.apps.live.standalone.package` writes at the head of the service worker. */
declare const PAGE: { version: string; files: string[]; scene: string; kept: string };
